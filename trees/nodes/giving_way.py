"""Give way to a person whose hand rests near the arm and waits for it to leave."""

from __future__ import annotations

import math

import numpy as np
from py_trees.common import Status

from cell.interfaces.judgement import HAND_TOO_NEAR
from cell.interfaces.observation import Observation
from cell.interfaces.pose import Array
from cell.interfaces.skill import Skill, SkillStatus
from trees.engine.ports import InputPort
from trees.nodes.skill_node import SkillNode

PAUSE_S = 0.5  # a hold that ended so long ago is over
STALE_S = 0.5  # an older view of the bench tells nothing of the hand


class GiveWay(SkillNode):
    """Where a near hand has held the arm for long: go out of its way, slowly, to the parking place, and wait there.

    Put it before a motion in a ReactiveSequence. It succeeds at once where nobody is in the way, and where no path
    leads away from the hand; while it is at work, the motion is halted, and begins anew when the hand has left.
    """

    claims = ("arm",)
    persistent = ("_since_s", "_held_s")

    after_s = InputPort(float, "how long a near hand may hold the arm before it gives way in [s]", default=8.0)
    wait_s = InputPort(float, "how long it waits for the hand to leave at most in [s]", default=15.0)

    _since_s = _held_s = -math.inf  # when the hold began that lasts, and when the arm was held last
    _held_rad: Array | None = None  # where the arm stood then; None while it does not give way
    _out_s = math.inf  # since when it is out of the way

    def initialise(self) -> None:
        self._held_rad, self._out_s = None, math.inf

    def make_skill(self) -> Skill:
        from skills.move_to import GiveWay as GiveWaySkill

        services = self.services
        return GiveWaySkill(services.motion, services.standing, services.held_part)

    def update(self) -> Status:
        seen = self.services.observation
        if self._held_for_long(seen):
            self._begin(seen)
        elif self._held_rad is None:
            return Status.SUCCESS
        if self._skill is not None:
            progress = self.poll()
            if progress.status is SkillStatus.RUNNING:
                return Status.RUNNING
            self._skill, self._out_s = None, seen.time_s
            if progress.status is SkillStatus.FAILURE:
                return Status.SUCCESS
        if seen.time_s - self._out_s > self.wait_s.get() or self._left(seen):
            return Status.SUCCESS
        self.feedback_message = "waits until the hand has left"
        self.services.show(message=f"waiting: {self.feedback_message}")
        return Status.RUNNING

    def _begin(self, seen: Observation) -> None:
        """Look for a way out, also where the last one was blocked in the middle."""
        if self._skill is not None:
            self._skill.halt(self.services.command)
        if self._held_rad is None:
            self._held_rad = np.array(seen.arm.positions_rad)
        self._skill, self._since_s = self.make_skill(), seen.time_s

    def _held_for_long(self, seen: Observation) -> bool:
        now_s = seen.time_s
        if HAND_TOO_NEAR not in seen.held_by:
            return False
        if now_s - self._held_s > PAUSE_S:
            self._since_s = now_s
        self._held_s = now_s
        return now_s - self._since_s >= self.after_s.get()

    def _left(self, seen: Observation) -> bool:
        """Whether the arm could stand again where it was held."""
        from skills.near_hand import separation_of

        monitor = self.services.motion.separation
        if seen.bench is None or seen.bench.hand_unknown or seen.time_s - seen.bench.time_s > STALE_S:
            return False
        found = separation_of(monitor, seen, None, self._held_rad)
        return found is None or found.distance_m > found.least_m + monitor.settings.hysteresis_m
