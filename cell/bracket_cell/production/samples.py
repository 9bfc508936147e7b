"""Numbers of the work for other systems, by OPC UA and as Prometheus' text: counts of the book, and what is now."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import get_args

from bracket_cell.production.book import Book
from bracket_cell.production.bookkeeper import Bookkeeper
from bracket_cell.production.effectiveness import Period
from bracket_ground.interfaces.observation import ArmMode

STATES = ("running", "held", "paused", "over")
HELP = {
    "cell_state": "1 for the state that the cell is in",
    "cell_brackets_total": "brackets that ended, by whether they were finished",
    "cell_placements_total": "parts placed, by who placed them",
    "cell_cycle_seconds": "how long finished brackets took",
    "cell_stops_total": "times the arm was held or the run stopped, by the sign that was seen",
    "cell_questions_total": "questions asked of a person",
    "cell_oee_ratio": "shares of ISO 22400-2 that are known, and the overall equipment effectiveness",
    "cell_clock_seconds": "time of the run's newest tick; it stands still where the run hangs",
    "cell_speed_ratio": "share of the arm's speed that is allowed now",
    "cell_alarm": "1 for the sign that has held the cell first, while it is held",
    "cell_arm_safety": "1 for the safety mode that the arm's controller is in",
    "cell_axis_position": "of each joint of the arm, in radians, of a linear axis in metres",
    "cell_order_done": "brackets finished of a work order that is open",
    "cell_order_amount": "brackets wanted of a work order that is open",
}
TOTALS = (
    "SELECT total(finished = 1) AS finished, total(finished = 0) AS not_finished, total(robot) AS robot, "
    "total(person) AS person, total(iif(finished, end_s - begin_s, 0)) AS cycles_s, "
    "total(json_array_length(questions)) AS questions FROM brackets"
)
Sample = tuple[str, dict[str, str], float]  # name, labels, value


class Samples:
    """All numbers as they are now; called from any thread.

    Args:
        keeper: of the run that goes on; None between runs.
    """

    def __init__(self, book: Book, keeper: Bookkeeper | None = None) -> None:
        self._book, self._keeper = book, keeper
        self._shares: tuple[tuple[int, int], tuple[Sample, ...]] = ((-1, -1), ())

    def __call__(self) -> tuple[Sample, ...]:
        version = self._book.version
        if version != self._shares[0]:  # a week of brackets is not added up twice a second
            self._shares = version, tuple(_shares(self._book))
        return (*_totals(self._book), *self._shares[1], *_now(self._keeper))


def metrics_of(samples: Iterable[Sample]) -> str:
    """The numbers in Prometheus' text format 0.0.4."""
    lines: list[str] = []
    family_before = ""
    for name, labels, value in samples:
        family = name.removesuffix("_sum").removesuffix("_count")
        if family != family_before:
            kind = "counter" if family.endswith("_total") else "summary" if family != name else "gauge"
            lines += [f"# HELP {family} {HELP[family]}", f"# TYPE {family} {kind}"]
            family_before = family
        marks = ",".join(f'{key}="{_escaped(text)}"' for key, text in labels.items())
        lines.append(f"{name}{'{' + marks + '}' if marks else ''} {value:g}")
    return "\n".join(lines) + "\n"


def _totals(book: Book) -> Iterator[Sample]:
    (total,) = book.ask(TOTALS)
    for finished, name in (("true", "finished"), ("false", "not_finished")):
        yield "cell_brackets_total", {"finished": finished}, total[name]
    for who in ("robot", "person"):
        yield "cell_placements_total", {"by": who}, total[who]
    yield "cell_cycle_seconds_sum", {}, round(total["cycles_s"], 3)
    yield "cell_cycle_seconds_count", {}, total["finished"]
    for row in book.ask("SELECT signal, sum(times) AS times FROM stops GROUP BY signal ORDER BY signal"):
        yield "cell_stops_total", {"reason": row["signal"]}, row["times"]
    yield "cell_questions_total", {}, total["questions"]


def _shares(book: Book) -> Iterator[Sample]:
    whole = Period.of(book).whole
    for share in ("availability", "effectiveness", "quality", "oee"):
        if (value := getattr(whole, share)) is not None:
            yield "cell_oee_ratio", {"share": share}, round(value, 4)


def _now(keeper: Bookkeeper | None) -> Iterator[Sample]:
    for state in STATES:
        yield "cell_state", {"state": state}, float(state == ("over" if keeper is None else keeper.state))
    if keeper is None or keeper.last is None:
        return
    seen = keeper.last.observation
    yield "cell_clock_seconds", {}, round(seen.time_s, 3)
    yield "cell_speed_ratio", {}, round(seen.speed_scale, 3)
    if keeper.alarm:
        yield "cell_alarm", {"signal": keeper.alarm}, 1.0
    for mode in get_args(ArmMode):
        yield "cell_arm_safety", {"mode": mode}, float(mode == seen.arm.mode)
    for axis, position in enumerate(seen.arm.positions_rad, start=1):
        yield "cell_axis_position", {"axis": str(axis)}, position
    for order in seen.operator.jobs:
        yield "cell_order_done", {"id": order.id, "variant": order.variant}, order.done
    for order in seen.operator.jobs:
        yield "cell_order_amount", {"id": order.id, "variant": order.variant}, order.amount


def _escaped(text: str) -> str:
    return text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
