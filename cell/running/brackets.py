"""What was done bracket by bracket, from the notes of the tree's nodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from cell.interfaces.perception import Frame
from cell.observer import Level, Outcome, TickRecord


@dataclass
class Bracket:
    """One bracket of a shift, as the controller saw it.

    Attributes:
        finished: every hole was seen filled; None while it is worked on.
        inferred_goal: most probable goal when it ended.
    """

    number: int
    begin_s: float
    end_s: float
    finished: bool | None = None
    inferred_goal: str | None = None
    help_requests: int = 0

    @property
    def sim_time_s(self) -> float:
        return self.end_s - self.begin_s


class BracketTally:
    """An observer that counts brackets; empty for a tree that names none.

    Attributes:
        brackets: in order.
    """

    def __init__(self) -> None:
        self.brackets: list[Bracket] = []

    def frame(self, frame: Frame) -> None:
        """Images are not counted."""

    def tick(self, record: TickRecord) -> None:
        now_s = record.observation.time_s
        for topic, fields in record.notes:
            if topic == "bracket" and fields["edge"] == "begin":
                self.brackets.append(Bracket(int(str(fields["number"])), now_s, now_s))
            elif topic == "bracket" and self._open is not None:
                self._open.end_s = now_s
                self._open.finished = bool(fields["finished"])
            elif topic == "help" and self.brackets:
                self.brackets[-1].help_requests += 1
        if (now := self._open) is not None:
            now.end_s = now_s
            if record.command.display is not None and (belief := record.command.display.goal_belief):
                now.inferred_goal = max(belief, key=lambda goal: belief[goal])

    def message(self, time_s: float, level: Level, text: str) -> None:
        """Messages are not counted."""

    def close(self, outcome: Outcome) -> None:
        """Nothing to do."""

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
    }
