"""When a bracket is finished, and what is still waited for when nothing else is left to do."""

from __future__ import annotations

import math

from py_trees.common import Status

from cell.interfaces.perception import BenchView
from cell.interfaces.planning import AssemblyState
from trees.engine.ports import InputPort
from trees.nodes.people import hole_on_bench_m
from trees.nodes.services import CellNode
from trees.nodes.watching import SeenAction

TELLS_S = 3.0  # the last part is in for so long before it is told why the bracket is not finished


class AssemblyFinished(CellNode):
    """Every position is filled, is seen to be, and the hand has left (condition of Alg. 1's while).

    A hand that is said to be at work has left, too, once it was away from every hole for a while: an action detector
    may err as long as the hand rests. A hole that nobody could make visible counts as the graph has it. Where only
    this is waited for, the person is told what.
    """

    state = InputPort(AssemblyState, "what is placed so far")
    action = InputPort(SeenAction, "what the person does")
    away_m = InputPort(float, "how far from every hole a hand has left that is said to be at work", default=0.2)
    away_s = InputPort(float, "how long it must be so far away", default=8.0)
    persistent = ("_full_since_s", "_away_since_s")

    _full_since_s: float | None = None
    _away_since_s: float | None = None

    def update(self) -> Status:
        services, reason = self.services, self._why_not()
        self.feedback_message = reason
        if not reason:
            services.show(message="the bracket is assembled", help_request=None)
            return Status.SUCCESS
        seen = services.observation
        told = self._full_since_s is not None and seen.time_s - self._full_since_s >= TELLS_S
        if told and not seen.arm.moving:
            services.show(message=f"waiting: {reason}")
        return Status.FAILURE

    def _why_not(self) -> str:
        """What is still waited for; empty where it is finished."""
        services, state = self.services, self.state.get()
        view, placed = services.observation.bench, state.placed
        if open_positions := [position for position in services.product.positions if position not in placed]:
            self._full_since_s = self._away_since_s = None
            return f"{len(open_positions)} positions are open"
        now_s = services.observation.time_s
        self._full_since_s = now_s if self._full_since_s is None else self._full_since_s
        left = self.action.get().action.kind == "idle" or self._left(view)
        asked = {position for position, part in state.kept.items() if part is None}
        seen = {} if view is None else {position: hole.part for position, hole in view.holes.items()}
        if unseen := [position for position in placed if seen.get(position) is None and position not in asked]:
            return f"not yet seen filled: {' '.join(unseen)}"
        return "" if left else "the hand still moves"

    def _left(self, view: BenchView | None) -> bool:
        """Whether the hand has been away from every hole for long enough."""
        now_s = self.services.observation.time_s
        if not self._away(view):
            self._away_since_s = None
            return False
        self._away_since_s = now_s if self._away_since_s is None else self._away_since_s
        return now_s - self._away_since_s >= self.away_s.get()

    def _away(self, view: BenchView | None) -> bool:
        if view is None or view.hand_unknown:
            return False
        if view.hand is None:
            return True
        holes = [hole_on_bench_m(self.services, position) for position in self.services.product.positions]
        points = (view.hand.palm_m, view.hand.fingertips_m)
        return all(math.dist(point, hole) >= self.away_m.get() for point in points for hole in holes)
