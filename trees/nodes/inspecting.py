"""What the overhead camera sees in the bracket, for trees that report it or decide by it."""

from __future__ import annotations

from py_trees.common import Status

from trees.engine.node import FAILURE, RUNNING, SUCCESS
from trees.engine.ports import InputPort, OutputPort
from trees.engine.vocabulary import Goal, Hole
from trees.nodes.services import CellNode

EMPTY = "empty"


class ReadHole(CellNode):
    """Wait for a clear view of a hole and tell what is in it."""

    position = InputPort(Hole, "the hole")
    timeout_s = InputPort(float, "longest wait for a clear view in [s]", default=3.0)
    part = OutputPort(str, f"type of the part in it, or '{EMPTY}'")
    upright = OutputPort(bool, "whether it stands straight")

    _begun_s = 0.0

    def initialise(self) -> None:
        self._begun_s = self.services.observation.time_s

    def update(self) -> Status:
        position, seen = self.position.get(), self.services.observation
        hole = seen.bench.holes.get(position) if seen.bench else None
        if hole is None or hole.seen_s <= self._begun_s:
            self.feedback_message = f"waits for a clear view of {position}"
            return FAILURE if seen.time_s - self._begun_s > self.timeout_s.get() else RUNNING
        self.part.set(hole.part or EMPTY)
        self.upright.set(hole.upright)
        self.feedback_message = f"{position}: {hole.part or EMPTY}{'' if hole.upright else ', tilted'}"
        return SUCCESS


class GoalPart(CellNode):
    """Tell which part a goal has at a position."""

    instant = True

    goal = InputPort(Goal, "the goal")
    position = InputPort(Hole, "the hole")
    part = OutputPort(str, "type of the part that belongs there")

    def update(self) -> Status:
        part = self.services.product.goal_placements(self.goal.get())[self.position.get()]
        self.part.set(part)
        self.feedback_message = f"{part} belongs at {self.position.get()}"
        return SUCCESS
