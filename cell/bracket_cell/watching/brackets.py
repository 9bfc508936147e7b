"""What was done bracket by bracket, from the notes of the tree's nodes."""

from __future__ import annotations

import resource
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bracket_cell.learned.semantic.goals import OpenGoals
from bracket_cell.watching.observer import Observer, Outcome, TickRecord
from bracket_ground.errors import InputError
from bracket_ground.interfaces.perception import BenchView
from bracket_ground.interfaces.product import Product

NOTHING: Mapping[str, float] = {}


class FinishedBrackets(Observer):
    """An observer that learns from how a run ended; what the cameras saw in the holes counts, not what was believed.

    Attributes:
        learned: the goal that the bracket ended in; None where it was not finished.
    """

    def __init__(self, path: Path, product: Product) -> None:
        self._path = path
        self._product = product
        self._view: BenchView | None = None
        self._shift = False  # brackets are noted one by one
        self.learned: str | None = None

    def tick(self, record: TickRecord) -> None:
        self._view = record.observation.bench or self._view
        for topic, fields in record.notes:
            if topic == "bracket":
                self._shift = True
                if fields.get("finished"):
                    self._learn()

    def close(self, outcome: Outcome) -> None:
        if outcome.end == "finished" and not self._shift:
            self._learn()

    def _learn(self) -> None:
        if self._view is None:
            return
        seen = {position: hole.part for position, hole in self._view.holes.items()}
        there = {at: part for at, part in seen.items() if part is not None}
        if len(there) < len(self._product.positions) and self._product.goal_of(there) is None:
            return
        parts = self._product.as_listed(there)
        try:
            goals = OpenGoals.load(self._path, self._product).with_bracket(parts)
        except InputError:
            return  # a hole was misread, or the file was damaged meanwhile: better nothing than a wrong goal
        goals.save(self._path)
        self.learned = goals.name_of(parts)


@dataclass
class Bracket:
    """One bracket of a shift, as the controller saw it.

    Attributes:
        finished: every hole was seen filled; None while it is worked on.
        inferred_goal: most probable goal when it ended.
        order: id of the work order that it serves; empty for none.
        known_wrong: holes that the cell knew to be wrong, and that nobody mended.
        rss_mb: memory of this process when it ended; None where the system does not tell.
    """

    number: int
    begin_s: float
    end_s: float
    finished: bool | None = None
    inferred_goal: str | None = None
    help_requests: int = 0
    order: str = ""
    known_wrong: tuple[str, ...] = ()
    rss_mb: float | None = None

    @property
    def sim_time_s(self) -> float:
        return self.end_s - self.begin_s


class BracketTally(Observer):
    """An observer that counts brackets; empty for a tree that names none.

    Attributes:
        brackets: in order.
    """

    def __init__(self) -> None:
        self.brackets: list[Bracket] = []

    def tick(self, record: TickRecord) -> None:
        display = record.command.display
        self.add(record.observation.time_s, record.notes, {} if display is None else display.goal_belief)

    def add(
        self, now_s: float, notes: Iterable[tuple[str, Mapping[str, Any]]], belief: Mapping[str, float] = NOTHING
    ) -> None:
        """One tick, of this run or of the one that it goes on with."""
        for topic, fields in notes:
            if topic == "bracket" and fields["edge"] == "begin":
                if self._open is None or self._open.number != fields["number"]:
                    self.brackets.append(Bracket(int(str(fields["number"])), now_s, now_s))
            elif topic == "bracket" and self._open is not None:
                self._open.end_s = now_s
                self._open.order = str(fields.get("order", ""))
                self._open.known_wrong = tuple(fields.get("known_wrong") or ())
                self._open.rss_mb = memory_mb()
                self._open.finished = bool(fields["finished"])
            elif topic == "help" and self.brackets:
                self.brackets[-1].help_requests += 1
        if (now := self._open) is not None:
            now.end_s = now_s
            if belief:
                now.inferred_goal = max(belief, key=lambda goal: belief[goal])

    def report(self, judged: Sequence[Mapping[str, object]]) -> dict[str, object]:
        """Keys of `cell run --json` for a shift; empty where no bracket was begun.

        Args:
            judged: how each bracket really was, in order, where somebody knows: keys of `Devices.report`.
        """
        if not self.brackets:
            return {}
        rows = [_row(one, judged[place] if place < len(judged) else {}) for place, one in enumerate(self.brackets)]
        return {
            "brackets": rows,
            "right": sum(row["correct"] is True for row in rows),
            "wrong": sum(row["correct"] is False and row["finished"] is True for row in rows),
            "unfinished": sum(row["correct"] is not True and row["finished"] is not True for row in rows),
            "asked": sum(one.help_requests for one in self.brackets),
        }

    def missing(self, judged: int) -> int:
        """How many brackets were judged before the first one here; less than 0 where that was at another bench.

        A bracket is judged when it is taken away, which is about when it is over.
        """
        begun, over = len(self.brackets), sum(one.finished is not None for one in self.brackets)
        return -over if judged < over - 1 else max(0, judged - begun)

    @property
    def _open(self) -> Bracket | None:
        return self.brackets[-1] if self.brackets and self.brackets[-1].finished is None else None


def _row(one: Bracket, judged: Mapping[str, object]) -> dict[str, object]:
    return {
        "number": one.number,
        "goal": judged.get("goal"),
        "inferred_goal": one.inferred_goal,
        "correct": judged.get("correct"),
        "finished": one.finished,
        "begin_s": round(one.begin_s, 3),
        "sim_time_s": round(one.sim_time_s, 3),
        "robot_placements": judged.get("robot_placements"),
        "human_placements": judged.get("human_placements"),
        "help_requests": one.help_requests,
        "order": one.order,
        "known_wrong": list(one.known_wrong),
        "rss_mb": one.rss_mb,
    }


def memory_mb() -> float | None:
    """Memory that this process has now."""
    with suppress(OSError):
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
        return round(pages * resource.getpagesize() / 2**20, 1)
    return None
