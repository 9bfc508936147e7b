"""Numbers of the work for other systems: state, counts, cycle times and stops, also as Prometheus' text."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import Any

from bracket_cell.watching.observer import Observer, Outcome, TickRecord
from bracket_ground.interfaces.faults import USUAL, Action

STATES = ("running", "held", "paused", "over")
HELP = {
    "cell_state": "1 for the state that the cell is in",
    "cell_brackets_total": "brackets that ended, by whether they were finished",
    "cell_placements_total": "parts placed, by who placed them",
    "cell_cycle_seconds": "how long finished brackets took",
    "cell_stops_total": "times the arm was held or the run stopped, by the sign that was seen",
    "cell_questions_total": "questions asked of a person",
    "cell_speed_ratio": "share of the arm's speed that is allowed now",
    "cell_order_done": "brackets finished of a work order that is open",
    "cell_order_amount": "brackets wanted of a work order that is open",
}
Sample = tuple[str, dict[str, str], float]  # name, labels, value


class Production(Observer):
    """An observer that counts; others read the numbers from any thread."""

    def __init__(self) -> None:
        self._samples: tuple[Sample, ...] = ()
        self._brackets: Counter[bool] = Counter()
        self._placed: Counter[str] = Counter()
        self._stops: Counter[str] = Counter()
        self._held: frozenset[str] = frozenset()
        self._questions = 0
        self._cycles_s = self._begun_s = 0.0
        self._by: dict[str, str] = {}  # who placed what is in the bracket, by position
        self._ended = False
        self._last: TickRecord | None = None

    def tick(self, record: TickRecord) -> None:
        self._last = record
        now_s, judged = record.observation.time_s, record.judgement
        notes: tuple[tuple[str, dict[str, Any]], ...] = record.notes
        for topic, fields in notes:
            if topic == "help":
                self._questions += 1
            elif topic == "belief" and fields.get("edge") and fields["edge"][0] is not None:
                who = "robot" if fields.get("source") == "robot" else "person"
                self._by[fields["edge"][1]] = who if who == "robot" else self._by.get(fields["edge"][1], who)
            elif topic == "belief" and fields.get("edge"):
                self._by.pop(fields["edge"][1], None)
            elif topic == "bracket" and fields["edge"] == "begin":
                self._begun_s = now_s
                self._placed.update(self._by.values())
                self._by = {}
            elif topic == "bracket":
                self._brackets[bool(fields["finished"])] += 1
                if fields["finished"]:
                    self._cycles_s += now_s - self._begun_s
        stops = judged is not None and judged.action >= Action.HOLD
        reasons = judged.reasons if judged is not None and stops else ()
        held = frozenset(signal for signal, _ in reasons if signal not in USUAL)
        self._stops.update(held - self._held)
        self._held = held

    def close(self, outcome: Outcome) -> None:  # noqa: ARG002 - how it ended is in the log
        self._ended = True

    @property
    def samples(self) -> tuple[Sample, ...]:
        """All numbers as they are now."""
        return tuple(self._now())

    def metrics(self) -> str:
        """The numbers in Prometheus' text format 0.0.4."""
        lines: list[str] = []
        told = ""
        for name, labels, value in self.samples:
            family = name.removesuffix("_sum").removesuffix("_count")
            if family != told:
                kind = "counter" if family.endswith("_total") else "summary" if family != name else "gauge"
                lines += [f"# HELP {family} {HELP[family]}", f"# TYPE {family} {kind}"]
                told = family
            marks = ",".join(f'{key}="{_escaped(text)}"' for key, text in labels.items())
            lines.append(f"{name}{'{' + marks + '}' if marks else ''} {value:g}")
        return "\n".join(lines) + "\n"

    def _now(self) -> Iterator[Sample]:
        for state in STATES:
            yield "cell_state", {"state": state}, float(state == self._state)
        for finished in (True, False):
            yield "cell_brackets_total", {"finished": str(finished).lower()}, self._brackets[finished]
        by = list(dict(self._by).values())
        for who in ("robot", "person"):
            yield "cell_placements_total", {"by": who}, self._placed[who] + by.count(who)
        yield "cell_cycle_seconds_sum", {}, round(self._cycles_s, 3)
        yield "cell_cycle_seconds_count", {}, self._brackets[True]
        for signal, count in dict(self._stops).items():
            yield "cell_stops_total", {"reason": signal}, count
        yield "cell_questions_total", {}, self._questions
        if self._last is not None:
            seen = self._last.observation
            yield "cell_speed_ratio", {}, round(seen.share, 3)
            for order in seen.operator.jobs:
                yield "cell_order_done", {"id": order.id, "variant": order.variant}, order.done
            for order in seen.operator.jobs:
                yield "cell_order_amount", {"id": order.id, "variant": order.variant}, order.amount

    @property
    def _state(self) -> str:
        if self._ended:
            return "over"
        if self._last is not None and self._last.observation.operator.pause != "none":
            return "paused"
        return "held" if self._held else "running"


def _escaped(text: str) -> str:
    return text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
