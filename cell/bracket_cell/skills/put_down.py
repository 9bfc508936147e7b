"""PutDown: stand the held part on a spot of the table, the tray or a place with a name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from bracket_cell.skills.grasping.entry import Entry
from bracket_cell.skills.grasping.handling import (
    bracket_boxes,
    carry_over_bracket_m,
    joints_of,
    lift_m,
    present_hold,
    put_phases,
    seen_in_holes,
    slips_m,
    tray_boxes,
)
from bracket_cell.skills.grasping.phases import Phase, PhasedSkill
from bracket_cell.skills.lying import put_lying_back, put_lying_down
from bracket_cell.skills.motion.collision import Box
from bracket_cell.skills.motion.grasp_pose import holds
from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_cell.skills.move_aside import free_spots
from bracket_ground.files.words.message import Message
from bracket_ground.interfaces.grip import Hold
from bracket_ground.interfaces.observation import Observation
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import PartType

UPRIGHT = 0.999  # cosine of the largest tilt of a spot that a part can stand on


@dataclass(eq=False)
class PutDown(PhasedSkill):
    """Carry the held part over a spot, lower it, let go and rise.

    Attributes:
        part: type of the part that the gripper holds.
        world_from_spot: what its peg will stand on; x along the part's length.
        where: the spot in words.
        standing: parts that stand in the tray or were put down before.
        place: name of the place that the spot is of, if it is of one.
    """

    planner: MotionPlanner = field(repr=False)
    part: str
    world_from_spot: Pose
    where: str
    standing: Sequence[PartDetection] = ()
    place: str = ""

    def prepare(self, observation: Observation) -> Sequence[Phase] | str:
        """Choose a heading of the tool."""
        planner = self.planner
        if not observation.gripper.holding:
            return Message("cannot put {part} down: the gripper holds nothing", part=self.part)
        if self.world_from_spot.rotation[2, 2] < UPRIGHT:
            return Message(
                "cannot put {part} down at {where}: nothing stands on a tilted spot", part=self.part, where=self.where
            )
        if planner.lying is not None:
            return put_lying_down(planner, self.part, self.world_from_spot, observation, self.standing)
        obstacles = (*bracket_boxes(planner, seen_in_holes(observation)), *tray_boxes(planner, self.standing))
        return self._planned(present_hold(planner, self.part, observation), obstacles, joints_of(observation))

    def _planned(self, hold: Hold, obstacles: tuple[Box, ...], near_rad: Array) -> Sequence[Phase] | str:
        planner, kind = self.planner, self.planner.product.parts[self.part]
        place = planner.bench.places.get(self.place)
        into_hole = place is not None and place.seat == "hole"
        target = stands_at(self.world_from_spot, 0.0 if into_hole else kind.peg_length_m)
        carry_m, entry = carry_over_bracket_m(planner, kind), None
        if place is not None:
            entry, there = Entry.of(planner, self.place, place), standing(self.part, kind, target)
            over_m = lift_m(planner, there, self.standing, place.rim_m)
            carry_m = over_m if entry else max(carry_m, over_m)
        return put_phases(
            planner, self.part, hold, target, obstacles, near_rad, carry_m, into_hole=into_hole, entry=entry
        )

    def why_never(self) -> str | None:
        """Why the arm cannot put the part there though nothing else stands on the bench, or None where it can."""
        if self.world_from_spot.rotation[2, 2] < UPRIGHT:
            return Message("nothing stands on a tilted spot")
        kind = self.planner.product.parts[self.part]
        settings, near_rad = self.planner.settings, np.array(self.planner.bench.arm_park_rad)
        ways = [
            holds(kind, grip, settings)[0] for grip in settings.gripper.grips(kind, settings.least_finger_clearance_m)
        ]
        found = [self._planned(hold, (), near_rad) for hold in ways]
        if any(not isinstance(phases, str) for phases in found):
            return None
        wrong = next((phases for phases in found if isinstance(phases, str)), None)
        return wrong or settings.gripper.why_not(kind, settings.least_finger_clearance_m)

    @property
    def done(self) -> str:
        """What the skill has achieved, in words."""
        return Message("{part} was let go at {where}", part=self.part, where=self.where)


def standing(part: str, kind: PartType, world_from_part: Pose) -> PartDetection:
    """What was put somewhere, as if it were seen there."""
    return PartDetection(part, 1.0, world_from_part, kind.size_m, (0, 0, 0, 0))


def stands_at(world_from_spot: Pose, peg_length_m: float) -> Pose:
    """World pose of a part whose peg stands on a spot."""
    x, y, z = world_from_spot.position_m
    return Pose.from_yaw((x, y, z + peg_length_m), world_from_spot.yaw_rad)


@dataclass(eq=False)
class PutBack(PhasedSkill):
    """Carry the held part to a free spot of the tray, let go and rise.

    Attributes:
        part: type of the part that the gripper holds.
        tray_parts: parts that stand in the tray, as last seen.
    """

    planner: MotionPlanner = field(repr=False)
    part: str
    tray_parts: Sequence[PartDetection]

    def prepare(self, observation: Observation) -> Sequence[Phase] | str:
        """Find a spot, then a way."""
        planner = self.planner
        if planner.lying is not None:
            return put_lying_back(planner, self.part, observation, self.tray_parts)
        kind = planner.product.parts[self.part]
        tray = planner.bench.tray
        obstacles = (*bracket_boxes(planner, seen_in_holes(observation)), *tray_boxes(planner, self.tray_parts))
        held = PartDetection(self.part, 1.0, Pose(tray.centre_m), kind.size_m, (0, 0, 0, 0))
        hold = present_hold(planner, self.part, observation)
        reason: str = Message("no free spot in the tray for {part}", part=self.part)
        for target in free_spots(held, kind, self.tray_parts, tray, planner.settings):
            phases = put_phases(
                planner,
                self.part,
                hold,
                target,
                obstacles,
                joints_of(observation),
                carry_over_bracket_m(planner, kind),
                slipped_m=slips_m(kind),
            )
            if not isinstance(phases, str):
                return phases
            reason = phases
        return reason

    @property
    def done(self) -> str:
        """What the skill has achieved, in words."""
        return Message("{part} was let go in the tray", part=self.part)
