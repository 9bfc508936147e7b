"""Give way to a person whose hand rests near the arm and waits for it to leave."""

from __future__ import annotations

import math

import numpy as np

from bracket_cell.trees.nodes.skill_node import SkillNode
from bracket_cell.trees.vocabulary import ShownAs
from bracket_ground.files.words.message import Message
from bracket_ground.interfaces.faults import HAND_TOO_NEAR
from bracket_ground.interfaces.observation import Observation
from bracket_ground.interfaces.perception import BenchView
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.skill import Skill, SkillStatus
from btxml.engine.ports import InputPort
from btxml.engine.status import Status
from btxml.engine.traits import Traits

PAUSE_S = 0.5  # a hold that ended so long ago is over
RESTS_M = 0.03  # a palm that moves less rests
STALE_S = 0.5  # an older view of the bench tells nothing of the hand


class GiveWay(SkillNode):
    """If a near hand has held the arm, or has rested beside it, for long: move out of its way to the parking place.

    Put it before a motion in a ReactiveSequence. It succeeds at once where nobody is in the way, and where no path
    leads away from the hand; while it is at work, the motion is halted, and begins anew when the hand has left.
    """

    traits = Traits(claims=("arm",), asked_again=True, shown_as=ShownAs.GIVES_WAY)
    persistent = ("_since_s", "_held_s", "_palm_m")

    after_s = InputPort(
        float, "how long arm and hand may wait for each other before it gives way in [s]", default=8.0, least=0
    )
    with_part_s = InputPort(
        float,
        "the same of a hand with a part in it, which waits to place it: acts of placing take 2 s",
        default=3.0,
        least=0,
    )
    near_m = InputPort(float, "how near to the arm a hand that rests must be for that in [m]", default=0.3, least=0)
    wait_s = InputPort(float, "how long it waits for the hand to leave at most in [s]", default=15.0, least=0)

    _since_s = _held_s = -math.inf  # when the wait began that lasts, and when the arm waited last
    _palm_m: tuple[float, float] = (math.inf, math.inf)  # where the hand has rested since
    _held_rad: Array | None = None  # where the arm stood then; None while it does not give way
    _out_s = math.inf  # since when it is out of the way

    def initialise(self) -> None:
        self._held_rad, self._out_s = None, math.inf

    def make_skill(self) -> Skill:
        from bracket_cell.skills import move_to

        services = self.services
        return move_to.GiveWay(services.tools.motion, *self.surroundings)

    def update(self) -> Status:
        seen = self.now.observation
        if self._waited_long(seen):
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
        if self.compare(seen.time_s - self._out_s, ">", self.wait_s) or self._left(seen):
            return Status.SUCCESS
        self.feedback_message = Message("waits until the hand has left")
        self.what_if = "if the hand were seen away from there"
        self.now.show(message=Message("waiting: {reason}", reason=self.feedback_message))
        return Status.RUNNING

    def _begin(self, seen: Observation) -> None:
        """Look for a way out, also where the last one was blocked in the middle."""
        if self._skill is not None:
            self._skill.halt(self.now.command)
        if self._held_rad is None:
            self._held_rad = np.array(seen.arm.positions_rad)
        self._skill, self._since_s = self.make_skill(), seen.time_s

    def _waited_long(self, seen: Observation) -> bool:
        now_s = seen.time_s
        if not self._waits(seen):
            return False
        if now_s - self._held_s > PAUSE_S:
            self._since_s = now_s
        self._held_s = now_s
        brings = _brings(seen.bench) and self.with_part_s.get() < self.after_s.get()
        return self.compare(now_s - self._since_s, ">=", self.with_part_s if brings else self.after_s)

    def _waits(self, seen: Observation) -> bool:
        """Whether a near hand holds the arm, or rests beside an arm that stands."""
        if HAND_TOO_NEAR in seen.holding_faults:
            return True
        hand = None if seen.bench is None else seen.bench.hand
        if hand is None or seen.speed_scale == 0 or seen.arm.moving or not seen.arm.stands:
            return False
        if math.dist(hand.palm_m, self._palm_m) > RESTS_M:
            self._palm_m, self._held_s = hand.palm_m, -math.inf  # from now on
            return False
        return self.compare(self._room_m(seen, None), "<", self.near_m)

    def _room_m(self, seen: Observation, joints_rad: Array | None) -> float:
        """From the hands to the arm, as it stands or where it would; infinite where no hand is."""
        from bracket_cell.skills.motion.near_hand import separation_of

        found = separation_of(self.tools.motion.separation, seen, None, joints_rad)
        return math.inf if found is None else found.distance_m

    def _left(self, seen: Observation) -> bool:
        """Whether no hand is near the place any more where the arm stood."""
        if seen.bench is None or seen.bench.hand_unknown or not seen.time_s - seen.bench.time_s <= STALE_S:
            return False
        return self.compare(self._room_m(seen, self._held_rad), ">=", self.near_m)


def _brings(view: BenchView | None) -> bool:
    """Whether the hand holds a part to place."""
    return (
        view is not None and view.hand is not None and view.hand.held_part is not None and view.action.kind != "screw"
    )
