"""Pick a part out of the tray and lift it, place it into a hole of the bracket (Alg. 1 "pick", "place")."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from bracket_cell.skills.grasping.entry import Entry
from bracket_cell.skills.grasping.handling import (
    IN_HOLE,
    LetGo,
    bracket_boxes,
    carry_over_bracket_m,
    choose_grasp,
    joints_of,
    lift_m,
    present_hold,
    put_phases,
    seen_in_holes,
    take_phases,
    tray_boxes,
    why_not_empty,
)
from bracket_cell.skills.grasping.phases import Phase, PhasedSkill
from bracket_cell.skills.motion.collision import Box, body_box
from bracket_cell.skills.motion.grasp_pose import hole_pose, place_poses
from bracket_cell.skills.motion.planner import Load, MotionPlanner
from bracket_ground.files.words.message import Message
from bracket_ground.interfaces.grip import Grip, Hold
from bracket_ground.interfaces.observation import Observation
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.pose import Array


@dataclass(eq=False)
class Pick(PhasedSkill):
    """Grasp a part from straight above and lift it; done when it is held above what stands near it.

    Attributes:
        part: the part to take, as last seen.
        others: all other parts that are known; the arm keeps clear of them.
        place: name of the place where it stands; empty for the tray.
        lifts: else it is done when the part is held, and the next motion begins with the way up.
    """

    planner: MotionPlanner = field(repr=False)
    part: PartDetection
    others: Sequence[PartDetection] = ()
    place: str = ""
    lifts: bool = True

    def prepare(self, observation: Observation) -> Sequence[Phase] | str:
        """Choose a grasp."""
        if (full := why_not_empty(observation)) is not None:
            return Message("cannot take {part}: {full}", part=self.part.part, full=full)
        return self._planned(joints_of(observation), bracket_boxes(self.planner, seen_in_holes(observation)))

    def why_never(self) -> str | None:
        """Why the arm cannot take the part though nothing else stands on the bench, or None where it can."""
        found = self._planned(np.array(self.planner.bench.arm_park_rad))
        return found if isinstance(found, str) else None

    def _planned(self, near_rad: Array, placed: tuple[Box, ...] = ()) -> Sequence[Phase] | str:
        planner = self.planner
        chosen = choose_grasp(planner, self.part, self.others, near_rad)
        if isinstance(chosen, str):
            return chosen
        if not self.place:
            tray = planner.bench.tray
            lifted_m = lift_m(planner, self.part, self.others, tray.centre_m[2] + tray.wall_m)
            stays = not self.lifts
            return take_phases(planner, self.part, self.others, chosen, lifted_m, placed=placed, stays=stays)
        place = planner.bench.places[self.place]
        lifted_m = lift_m(planner, self.part, self.others, place.rim_m)
        entry = Entry.of(planner, self.place, place)
        return take_phases(planner, self.part, self.others, chosen, lifted_m, entry, placed)

    @property
    def done(self) -> str:
        """What the skill has achieved, in words."""
        return Message("holding {part}", part=self.part.part)


@dataclass(eq=False)
class Place(PhasedSkill):
    """Carry the held part over a hole, lower its peg into it and let go; the next motion begins with the way up.

    Attributes:
        position: name of the hole.
        part: type of the part that the gripper holds.
        tray_parts: parts that remain in the tray; the arm keeps clear of them.
    """

    planner: MotionPlanner = field(repr=False)
    position: str
    part: str
    tray_parts: Sequence[PartDetection] = ()

    def prepare(self, observation: Observation) -> Sequence[Phase] | str:
        """Refuse a filled hole, choose a heading of the tool; a release that was broken off goes on."""
        planner, placed = self.planner, seen_in_holes(observation)
        planner.forget_left(joints_of(observation))
        kind, target = planner.product.parts[self.part], hole_pose(planner.product, planner.bench, self.position)
        hold = present_hold(planner, self.part, observation)
        stands = body_box(f"{self.part}{IN_HOLE}", target, kind.size_m)
        if planner.around == stands:
            settings = planner.settings
            wide_m = settings.gripper.opening_for(kind, hold.grip, settings.finger_clearance_m)
            return [LetGo.of(self.part, planner, max(wide_m, observation.gripper.opening_m), stands)]
        if planner.lying is not None:
            return Message(
                "cannot put {part} at {position}: it is held as it lay", part=self.part, position=self.position
            )
        if self.position in placed:
            return Message(
                "cannot put {part} at {position}: {placed} is there",
                part=self.part,
                position=self.position,
                placed=placed[self.position],
            )
        obstacles = (*bracket_boxes(planner, placed), *tray_boxes(planner, self.tray_parts))
        carry_m = carry_over_bracket_m(planner, kind)
        near_rad = joints_of(observation)
        return put_phases(planner, self.part, hold, target, obstacles, near_rad, carry_m, into_hole=True, stays=True)

    @property
    def done(self) -> str:
        """What the skill has achieved, in words."""
        return Message("{part} was let go at {position}", part=self.part, position=self.position)


def can_place(planner: MotionPlanner, part: str, position: str) -> bool:
    """Whether the arm reaches a hole of the empty bracket with a part, held across its width and in its middle."""
    kind = planner.product.parts[part]
    poses = place_poses(hole_pose(planner.product, planner.bench, position), kind, planner.settings, Hold(Grip.WIDTH))
    load = Load(kind.size_m[1], close=True)
    return not isinstance(planner.reach(poses, np.array(planner.bench.arm_park_rad), load), str)
