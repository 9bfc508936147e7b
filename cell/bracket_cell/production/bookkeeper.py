"""Writes the book of production: from a run's ticks, or from those of its log, by the same rules."""

from __future__ import annotations

import resource
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from bracket_cell.production.book import Book, BracketRow, RunRow
from bracket_cell.watching.observer import Observer, Outcome, TickRecord
from bracket_ground.interfaces.faults import USUAL, Action
from bracket_ground.interfaces.observation import Observation

ROBOT, PERSON = "robot", "person"


class Placements:
    """Follows the notes of a tree's nodes from the beginning of a bracket.

    Attributes:
        parts: part type by position.
        by: "robot" or "person" by position. A part is the robot's if its node says so, or if it fetched this type for
            this hole and the part was seen there without a hand that placed it. A hole that is emptied and filled anew
            is decided anew.
    """

    def __init__(self) -> None:
        self.parts: dict[str, str] = {}
        self.by: dict[str, str] = {}
        self._fetched: dict[str, str] = {}

    def note(self, topic: str, fields: Mapping[str, Any]) -> None:
        """Take one note."""
        if topic == "bracket" and fields["edge"] == "begin" and not fields.get("resumed"):
            self.parts, self.by, self._fetched = {}, {}, {}
        elif topic == "verdict" and fields.get("decision") == "act" and fields.get("part"):
            self._fetched[str(fields["position"])] = str(fields["part"])
        elif topic == "belief" and fields.get("edge"):
            part, position = fields["edge"]
            self._edge(part, position, str(fields.get("source", "")))

    def _edge(self, part: str | None, position: str, source: str) -> None:
        known = self.parts.pop(position, None)
        who = self.by.pop(position, PERSON)
        if part is None:
            return
        fetched = self._fetched.get(position) == part and source != "action"
        if known != part:
            who = ROBOT if fetched else PERSON
        self.parts[position], self.by[position] = part, ROBOT if source == ROBOT else who
        self._fetched.pop(position, None)


BESIDE_WORK = ("bracket", "mend")  # kinds of questions that hold nothing up by themselves
PAUSED = "paused by the operator"
WRITTEN_S = 5.0  # so often a run's length is written


@dataclass(frozen=True)
class Moment:
    """What production has to know of a tick.

    Attributes:
        notes: of the tree's nodes.
        held: by what the arm is held, in words; empty where it is not.
        signals: of trouble that hold it.
        asked: (kind, reason) of the questions that stand.
        paused: by the operator.
        belief: probability by goal; empty where it did not change.
    """

    time_s: float
    notes: Sequence[tuple[str, Mapping[str, Any]]]
    held: str = ""
    signals: frozenset[str] = frozenset()
    asked: Sequence[tuple[str, str]] | None = None
    paused: bool = False
    belief: Mapping[str, float] = field(default_factory=dict)


class Bookkeeper(Observer):
    """An observer that writes one run into a book; of a tree that names no brackets, only when it ran.

    Attributes:
        run: its number in the book.
        rows: its brackets, in order.
        inferred: most probable goal of each, when it ended.
        memory_mb: of this process when it ended; None where the system does not tell.
        placements: who placed what in the bracket that is there now.
        questions: how many were asked in the run.
        state: "running", "held", "paused" or "over".
        last: the newest tick; None before the first, and where a log is read.
    """

    def __init__(self, book: Book, run: RunRow) -> None:
        self.book, self.run = book, book.begin(run)
        self.rows: list[BracketRow] = []
        self.inferred: list[str | None] = []
        self.memory_mb: list[float | None] = []
        self.placements, self.questions, self.state = Placements(), 0, "running"
        self.last: TickRecord | None = None
        self._asked: Sequence[tuple[str, str]] = ()
        self._signals: frozenset[str] = frozenset()
        self._reason, self._between_s = "", dict[str, float]()
        self._before_s: float | None = None
        self._lasted_s = self._written_s = 0.0
        self._cause = ""

    @property
    def alarm(self) -> str:
        """The signal that has held the cell first, and others may follow from; empty where it is not held."""
        return self._cause if self._signals else ""

    def tick(self, record: TickRecord) -> None:
        self.last = record
        self.take(_moment(record))

    def take(self, now: Moment) -> None:
        """One more tick, of this run or of the one that it goes on with."""
        elapsed_s = 0.0 if self._before_s is None else max(0.0, now.time_s - self._before_s)
        self._before_s, self._lasted_s = now.time_s, self._lasted_s + elapsed_s
        self._wait(now, elapsed_s)
        self._asked = self._asked if now.asked is None else now.asked
        for signal in now.signals - self._signals:
            self.book.stopped(self.run, signal)
            self._cause = signal if not self._signals else self._cause
        self._signals = now.signals
        self.state = "paused" if now.paused else "held" if now.signals else "running"
        if (row := self._open) is not None:
            row.end_s = max(row.end_s, now.time_s)  # a run that goes on with another has a new clock
            if now.belief:
                self.inferred[-1] = max(now.belief, key=lambda goal: now.belief[goal])
        for topic, fields in now.notes:
            self.placements.note(topic, fields)
            self._note(topic, fields, now.time_s)
        if self._lasted_s - self._written_s >= WRITTEN_S:
            self._written_s = self._lasted_s
            self.book.lasted(self.run, self._lasted_s)

    def close(self, outcome: Outcome) -> None:
        self.state = "over"
        signal = self._cause if outcome.end == "fault" and outcome.arm_stands else ""  # else people keep away first
        self.end(outcome.end, signal, outcome.reason)

    def end(self, ended: str, signal: str = "", reason: str = "") -> None:
        """The run is over; the bracket that was worked on stays unfinished."""
        if self._open is not None:
            self.book.write(self.run, self._open)
        self._write_waits()
        self.book.end(self.run, self._lasted_s, ended, signal, reason)

    def judge(self, judged: Sequence[Mapping[str, object]]) -> list[dict[str, object]]:
        """Rows of `cell run --json`; the book learns which brackets are right.

        Args:
            judged: how each bracket really was, in order, where somebody knows: keys of `Devices.report`.
        """
        rows = []
        for place, row in enumerate(self.rows):
            verdict = judged[place] if place < len(judged) else {}
            if row.finished is not None and isinstance(correct := verdict.get("correct"), bool):
                row.correct = correct
                self.book.inspected(self.run, row.number, correct)
            rows.append(self._plain(place, verdict))
        return rows

    def report(self, judged: Sequence[Mapping[str, object]]) -> dict[str, object]:
        """Keys of `cell run --json` for a shift; empty where no bracket was begun."""
        if not self.rows:
            return {}
        rows = self.judge(judged)
        return {
            "brackets": rows,
            "right": sum(row["correct"] is True for row in rows),
            "wrong": sum(row["correct"] is False and row["finished"] is True for row in rows),
            "unfinished": sum(row["correct"] is not True and row["finished"] is not True for row in rows),
            "asked": sum(len(row.questions) for row in self.rows),
        }

    def missing(self, judged: int) -> int:
        """How many brackets were judged before the first one here; less than 0 where that was at another bench.

        A bracket is judged when it is taken away, which is about when it is over.
        """
        begun, over = len(self.rows), sum(row.finished is not None for row in self.rows)
        return -over if judged < over - 1 else max(0, judged - begun)

    @property
    def _open(self) -> BracketRow | None:
        return self.rows[-1] if self.rows and self.rows[-1].finished is None else None

    def _wait(self, now: Moment, elapsed_s: float) -> None:
        """One reason counts for each moment: what holds the arm, a pause, or the first question."""
        asked = next((reason for kind, reason in self._asked if kind not in BESIDE_WORK), "")
        reason = now.held or (PAUSED if now.paused else asked)
        if reason:
            waits_s = self._between_s if self._open is None else self._open.waits_s
            waits_s[reason] = waits_s.get(reason, 0.0) + elapsed_s
        if reason != self._reason:
            self._write_waits()
        self._reason = reason

    def _write_waits(self) -> None:
        self.book.waited(self.run, self._between_s)

    def _note(self, topic: str, fields: Mapping[str, Any], time_s: float) -> None:
        row = self._open
        if topic == "bracket" and fields["edge"] == "begin":
            self._begin(row, fields, time_s)
        elif topic == "help":
            self.questions += 1
            if self.rows:
                self.rows[-1].questions.append(str(fields.get("text")))
        elif row is not None and topic == "belief" and fields.get("edge"):
            row.placed = {at: (part, self.placements.by[at]) for at, part in self.placements.parts.items()}
        elif row is not None and topic == "bracket":
            row.finished, row.variant = bool(fields["finished"]), str(fields.get("goal") or "")
            row.order, row.known_wrong = str(fields.get("order") or ""), list(fields.get("known_wrong") or ())
            self.memory_mb[-1] = memory_mb()
        else:
            return
        if self.rows:
            self.book.write(self.run, self.rows[-1])

    def _begin(self, row: BracketRow | None, fields: Mapping[str, Any], time_s: float) -> None:
        number, ordered = int(fields["number"]), str(fields.get("order") or "")
        if row is not None and row.number == number:  # of the run that this one goes on with, whose clock was another
            row.begin_s, row.end_s = time_s - row.length_s, time_s
            return
        self.rows.append(BracketRow(number, time_s, time_s, ordered=ordered))
        self.inferred.append(None)
        self.memory_mb.append(None)

    def _plain(self, place: int, judged: Mapping[str, object]) -> dict[str, object]:
        row = self.rows[place]
        return {
            "number": row.number,
            "goal": judged.get("goal"),
            "inferred_goal": self.inferred[place],
            "variant": row.variant,
            "correct": judged.get("correct"),
            "finished": row.finished,
            "begin_s": round(row.begin_s, 3),
            "sim_time_s": round(row.length_s, 3),
            "waited_s": round(row.waited_s, 3),
            "robot_placements": row.robot,
            "human_placements": row.person,
            "help_requests": len(row.questions),
            "ordered": row.ordered,
            "order": row.order,
            "known_wrong": row.known_wrong,
            "rss_mb": self.memory_mb[place],
        }


def _moment(record: TickRecord) -> Moment:
    judged, display, seen = record.judgement, record.command.display, record.observation
    stops = judged is not None and judged.action >= Action.HOLD
    reasons = judged.reasons if judged is not None and stops else ()
    return Moment(
        seen.time_s,
        record.notes,
        str(reasons[0][1]) if reasons else "",
        frozenset(signal for signal, _ in reasons if signal not in USUAL),
        None if display is None else [(question.kind, str(question.reason)) for question in display.questions],
        seen.operator.pause == "now",
        {} if display is None else display.goal_belief,
    )


class LoggedTick(Protocol):
    """A tick as a log has it: judgement and display as plain data."""

    @property
    def time_s(self) -> float: ...
    @property
    def observation(self) -> Observation: ...
    @property
    def notes(self) -> Sequence[tuple[str, Mapping[str, Any]]]: ...
    @property
    def judgement(self) -> Mapping[str, Any] | None: ...
    @property
    def display(self) -> Mapping[str, Any] | None: ...


def moment_of(tick: LoggedTick) -> Moment:
    """The same of a tick as a log has it."""
    judged, display = tick.judgement or {}, tick.display
    stops = judged.get("action") in (Action.HOLD.name, Action.STOP.name)
    reasons = (judged.get("reasons") or ()) if stops else ()
    return Moment(
        tick.time_s,
        tick.notes,
        str(reasons[0]["words"]) if reasons else "",
        frozenset(str(reason.get("signal")) for reason in reasons if reason.get("signal") not in USUAL),
        None if display is None else [(asks["kind"], str(asks["reason"])) for asks in display.get("questions") or ()],
        tick.observation.operator.pause == "now",
        {} if display is None else display.get("goal_belief") or {},
    )


def memory_mb() -> float | None:
    """Memory that this process has now."""
    with suppress(OSError):
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
        return round(pages * resource.getpagesize() / 2**20, 1)
    return None
