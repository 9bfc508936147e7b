"""What picking, placing and moving aside share: phases that take a part and that put it down."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from bracket_cell.skills.grasping.contact import RESTS_M, Descend, Insert, Lower, SetDown
from bracket_cell.skills.grasping.entry import Entry
from bracket_cell.skills.grasping.phases import Activate, Move, Phase, SetGripper, failed
from bracket_cell.skills.motion.collision import Box, body_box, part_box
from bracket_cell.skills.motion.grasp_pose import (
    Grasp,
    fingers_clear,
    fits,
    grasps,
    grip_of,
    held_boxes,
    holds,
    hole_pose,
    place_poses,
)
from bracket_cell.skills.motion.lying_grasp import held_box
from bracket_cell.skills.motion.motions import FreeWay, Line, Rise, WayAndLine
from bracket_cell.skills.motion.planner import Load, MotionPlanner, at_height
from bracket_cell.skills.motion.settings import MotionSettings
from bracket_ground.files.words.message import Message
from bracket_ground.interfaces.command import Command, GripperCommand
from bracket_ground.interfaces.grip import Grip, Hold, hold_of
from bracket_ground.interfaces.observation import Observation
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import PartType
from bracket_ground.interfaces.skill import Progress, SkillStatus

IN_HOLE = " in its hole"
_NEAR_M = 0.13  # half the gripper's width and half the longest part


def tray_boxes(planner: MotionPlanner, others: Sequence[PartDetection]) -> tuple[Box, ...]:
    """Seen parts as obstacles."""
    return tuple(
        part_box(other, planner.product, f"{other.part} in the tray ({number})") for number, other in enumerate(others)
    )


def bracket_boxes(planner: MotionPlanner, placed: Mapping[str, str]) -> tuple[Box, ...]:
    """Parts in holes as obstacles; `placed`: part type by position."""
    return tuple(
        body_box(
            f"{part} at {position}",
            hole_pose(planner.product, planner.bench, position),
            planner.product.parts[part].size_m,
        )
        for position, part in placed.items()
    )


def seen_in_holes(observation: Observation) -> dict[str, str]:
    """Part type by position, as the overhead camera last saw it."""
    if observation.bench is None:
        return {}
    return {position: hole.part for position, hole in observation.bench.holes.items() if hole.part is not None}


def why_not_empty(observation: Observation) -> str | None:
    """Why nothing can be taken now: fingers that open for it would drop what they hold; None where they are empty."""
    return "the gripper holds a part already" if observation.gripper.holding else None


def joints_of(observation: Observation) -> Array:
    """Joints (n,) as measured."""
    return np.array(observation.arm.positions_rad)


def choose_grasp(
    planner: MotionPlanner, part: PartDetection, others: Sequence[PartDetection], near_rad: Array
) -> tuple[Grasp, Array] | str:
    """How to take a part and the joints for it; or why it cannot be taken.

    Across the width where the fingers have room there, else across the length, where the stroke allows that; with the
    usual room around the fingers if there is that much, else with the least; and only then beside the part's middle.
    """
    settings, kind = planner.settings, planner.product.parts[part.part]
    reasons: dict[Grip, str] = {}
    for hold, close in ways_to_hold(kind, settings):
        chosen = _choose(planner, grasps(part, kind, settings, hold, close=close), others, near_rad)
        if not isinstance(chosen, str):
            return chosen
        reasons.setdefault(hold.grip, f"{chosen} {hold.grip.value}")
    why = ", ".join(reasons.values()) or settings.gripper.why_not(kind, settings.least_finger_clearance_m)
    return Message("cannot take {part}: {why}", part=part.part, why=why)


def ways_to_hold(kind: PartType, settings: MotionSettings) -> Iterator[tuple[Hold, bool]]:
    """All ways to hold a part, the best first, each with whether it leaves the fingers the least room."""
    grips = settings.gripper.grips(kind, settings.least_finger_clearance_m)
    found = [holds(kind, grip, settings) for grip in grips]
    for tried in ([ways[0] for ways in found], [hold for ways in found for hold in ways[1:]]):
        yield from ((hold, close) for close in (False, True) for hold in tried)


def why_not_graspable(
    planner: MotionPlanner, part: PartDetection, others: Sequence[PartDetection], near_rad: Array
) -> str | None:
    """Why the arm cannot grasp a part as it stands, or None where it can."""
    chosen = choose_grasp(planner, part, others, near_rad)
    return chosen if isinstance(chosen, str) else None


def take_phases(
    planner: MotionPlanner,
    part: PartDetection,
    others: Sequence[PartDetection],
    chosen: tuple[Grasp, Array],
    carry_m: float,
    entry: Entry | None = None,
    placed: tuple[Box, ...] = (),
    *,
    stays: bool = False,
) -> list[Phase] | str:
    """Phases that end with the part held, its body's bottom at the height `carry_m`; or why it cannot be taken.

    Args:
        placed: parts in holes, which the way there passes.
        entry: of the place where it stands, if that is entered from a side.
        stays: it is held where it stood; the next motion lifts it so high at first, without a stop there.
    """
    grasp, joints = chosen
    settings, name = planner.settings, part.part
    others_boxes = tray_boxes(planner, others)
    above_part = Load(grasp.opening_m, (*placed, *others_boxes, part_box(part, planner.product, name)))
    around_part = Load(grasp.opening_m, others_boxes, close=True)
    approach = at_height(grasp.world_from_tool, _approach_height_m(planner, part, others, grasp))
    above = planner.kinematics.follow(approach, joints)
    if above is None:
        return Message("cannot take {name}: out of the arm's reach above it", name=name)
    bottom_m = part.world_from_part.position_m[2]
    lifted_m = max(carry_m, bottom_m) + grasp.height_m
    planner.hold, planner.lying = grasp.hold, None
    descent_m_s = settings.close_speed_m_s if grasp.close else None
    phases: list[Phase] = [
        Activate(),
        Descend(name, planner, above, above_part, Line(planner, grasp.world_from_tool, around_part, descent_m_s)),
        TakeHold.of(part, planner, grasp, at_height(grasp.world_from_tool, lifted_m)),
    ]
    if stays:
        return phases
    phases.append(Move(Message("lifting {name}", name=name), Rise(planner, lifted_m, grasp.opening_m), holding=name))
    if entry is None:
        return phases
    carried = held_boxes(name, settings=settings, kind=planner.product.parts[name], hold=grasp.hold, with_peg=True)
    lifted = at_height(grasp.world_from_tool, lifted_m)
    loads = above_part, Load(grasp.opening_m, others_boxes, carried, close=True)
    return entry.wrap(phases, above, lifted, loads, ("", name))


def put_phases(
    planner: MotionPlanner,
    name: str,
    hold: Hold,
    target: Pose,
    obstacles: tuple[Box, ...],
    near_rad: Array,
    carry_m: float,
    *,
    into_hole: bool = False,
    stays: bool = False,
    slipped_m: float = RESTS_M,
    entry: Entry | None = None,
) -> list[Phase] | str:
    """Phases that put the held part at `target` (its part frame), and end with the empty fingers above it.

    Args:
        hold: how the fingers hold it.
        carry_m: height of the body's bottom on the way there.
        into_hole: the peg goes into a hole, and feels for it.
        stays: the fingers stay around the part; the next motion takes them away, without a stop above it.
        slipped_m: how far above `target` the part may meet the ground.
        entry: of the place, if that is entered from a side.
    """
    settings, kind = planner.settings, planner.product.parts[name]
    opening_m = settings.gripper.opening_for(kind, hold.grip, settings.finger_clearance_m)
    carrying = Load(opening_m, obstacles, held_boxes(name, kind, settings, hold, with_peg=True))
    lowering = Load(opening_m, obstacles, held_boxes(name, kind, settings, hold, with_peg=False), close=True)
    rise_m = max(carry_m - target.position_m[2], settings.release_gap_m)
    found = planner.reach(place_poses(target, kind, settings, hold), near_rad, lowering, rise_m)
    if isinstance(found, str):
        return Message("cannot put {name} there: {found}", name=name, found=found)
    pose, joints = found
    above = planner.kinematics.follow(at_height(pose, pose.position_m[2] + rise_m), joints)
    if above is None:
        return Message("cannot put {name} there: out of the arm's reach above it", name=name)
    depth_m = kind.peg_length_m + settings.insertion_start_m
    before = at_height(pose, pose.position_m[2] + depth_m)
    clear_m = _clear_height_m(planner, kind, target)
    phases: list[Phase] = (
        [
            Lower.of(name, WayAndLine(planner, above, carrying, Line(planner, before, lowering))),
            Insert(name, planner, pose, depth_m, lowering),
        ]
        if into_hole
        else [
            Move(Message("carrying {name}", name=name), FreeWay(planner, above, carrying), holding=name),
            SetDown(name, Line(planner, pose, lowering), slipped_m),
        ]
    )
    if stays:
        return [*phases, LetGo.of(name, planner, opening_m, body_box(f"{name}{IN_HOLE}", target, kind.size_m))]
    phases += release_phases(planner, name, opening_m, clear_m)
    if entry is None:
        return phases
    standing = body_box(name, target, kind.size_m)
    leaving = Load(opening_m, (*obstacles, standing), close=True)
    return entry.wrap(phases, above, at_height(pose, clear_m), (carrying, leaving), (name, ""))


def release_phases(planner: MotionPlanner, name: str, opening_m: float, clear_m: float) -> list[Phase]:
    """Phases that open the fingers around a part that stands or lies, and lift them to a height above it."""
    return [
        LetGo.of(name, planner, opening_m),
        Move(Message("leaving {name}", name=name), Rise(planner, clear_m, opening_m)),
    ]


@dataclass(eq=False)
class TakeHold(SetGripper):
    """Close the fingers on a part; what is of another width they let go again, where it stands.

    Attributes:
        part: as it was seen.
        grasp: how; beside the middle of a part it is not known how wide that is.
        lifts_to: as the planner's, told to it once the part is held.
    """

    planner: MotionPlanner = field(repr=False)
    part: PartDetection
    grasp: Grasp
    lifts_to: Pose
    _release: LetGo | None = field(default=None, init=False)

    @staticmethod
    def of(part: PartDetection, planner: MotionPlanner, grasp: Grasp, lifts_to: Pose) -> TakeHold:
        """With the settings of a planner."""
        settings, doing = planner.settings, Message("grasping {name}", name=part.part)
        close = GripperCommand(0.0, settings.gripper_speed_m_s, settings.grip_force_n)
        return TakeHold(doing, close, settings, planner, part, grasp, lifts_to, must_hold=True)

    def poll(self, observation: Observation, command: Command) -> Progress:
        """Close them, and look how far."""
        if self._release is None:
            progress = super().poll(observation, command)
            if progress.status is not SkillStatus.SUCCESS:
                return progress
            if self._fits(observation.gripper.opening_m):
                self.planner.lifts_to = self.lifts_to
                return progress
            self._release = LetGo.of(self.part.part, self.planner, self.grasp.opening_m, self._whatever())
        progress = self._release.poll(observation, command)
        if progress.status is not SkillStatus.SUCCESS:
            return progress
        return failed(Message("grasping {name}: by its width it is something else", name=self.part.part))

    def _whatever(self) -> Box:
        """What stands there may be as high as any part."""
        length_m, width_m, _ = self.part.size_m
        high_m = max(kind.size_m[2] for kind in self.planner.product.parts.values())
        return body_box(f"what stands for {self.part.part}", self.part.world_from_part, (length_m, width_m, high_m))

    def _fits(self, opening_m: float) -> bool:
        kind = self.planner.product.parts[self.part.part]
        return self.grasp.hold.place_m != 0.0 or fits(kind, opening_m, self.planner.settings)


@dataclass(eq=False)
class LetGo(SetGripper):
    """Open the fingers; the planner is told what they stand around, if the next motion begins there."""

    planner: MotionPlanner = field(repr=False)
    around: Box | None

    @staticmethod
    def of(name: str, planner: MotionPlanner, opening_m: float, around: Box | None = None) -> LetGo:
        """With the settings of a planner."""
        settings, doing = planner.settings, Message("letting go of {name}", name=name)
        release = GripperCommand(opening_m, settings.gripper_speed_m_s, settings.grip_force_n)
        return LetGo(doing, release, settings, planner, around)

    def poll(self, observation: Observation, command: Command) -> Progress:
        """Open them; a hand may be told to leave while they open, too."""
        self.planner.around = self.around
        return super().poll(observation, command)


def slips_m(kind: PartType) -> float:
    """How much lower a held part can hang than it was taken: pulled down by its height, or tilted."""
    length_m, _, height_m = kind.size_m
    return max(height_m, length_m / 2)


def carry_over_bracket_m(planner: MotionPlanner, kind: PartType) -> float:
    """Height of a carried body's bottom that clears every part on the bracket."""
    tallest = max(part.size_m[2] for part in planner.product.parts.values())
    return planner.bench.bracket.position_m[2] + tallest + kind.peg_length_m + planner.settings.carry_gap_m


def lift_m(planner: MotionPlanner, part: PartDetection, others: Sequence[PartDetection], rim_m: float) -> float:
    """Height of a lifted body's bottom that clears what stands near it, and a rim of this height."""
    tops = [rim_m, *_tops_near_m(part, others)]
    return max(tops) + planner.product.parts[part.part].peg_length_m + planner.settings.carry_gap_m


def present_hold(planner: MotionPlanner, name: str, observation: Observation) -> Hold:
    """How the fingers hold a part of this type: their opening tells the sides, how it was taken tells where."""
    grip = grip_of(planner.product.parts[name], observation.gripper.opening_m, planner.settings)
    return hold_of(grip, planner.hold)


def carried(planner: MotionPlanner, name: str | None, observation: Observation) -> tuple[str | None, tuple[Box, ...]]:
    """The held part's type and its boxes in the tool frame, as far as it is known what the gripper holds."""
    if name is None or not observation.gripper.holding:
        return None, ()
    kind = planner.product.parts[name]
    if planner.lying is not None:
        return name, (held_box(name, kind, planner.lying),)
    hold = present_hold(planner, name, observation)
    return name, held_boxes(name, kind, planner.settings, hold, with_peg=True)


def _choose(
    planner: MotionPlanner, options: Sequence[Grasp], others: Sequence[PartDetection], near_rad: Array
) -> tuple[Grasp, Array] | str:
    """The nearer of two grasps that are half a turn apart."""
    if not fingers_clear(options[0], others, planner.settings):
        return "no room for the fingers"
    load = Load(options[0].opening_m, tray_boxes(planner, others), close=True)
    found = planner.reach([option.world_from_tool for option in options], near_rad, load)
    if isinstance(found, str):
        return found
    pose, joints = found
    return next(option for option in options if option.world_from_tool == pose), joints


def _approach_height_m(
    planner: MotionPlanner, part: PartDetection, others: Sequence[PartDetection], grasp: Grasp
) -> float:
    """TCP height at which the fingertips pass over the part and its near neighbours."""
    settings, kind = planner.settings, planner.product.parts[part.part]
    top_m = max(part.world_from_part.position_m[2] + kind.size_m[2], *_tops_near_m(part, others), -np.inf)
    over_m = settings.gripper.fingertip_beyond_tcp_m + settings.approach_gap_m
    return max(top_m, grasp.world_from_tool.position_m[2]) + over_m


def _tops_near_m(part: PartDetection, others: Sequence[PartDetection]) -> list[float]:
    """Of the parts that the gripper or the part in it could touch."""
    x, y, _ = part.world_from_part.position_m
    places = [(other, other.world_from_part.position_m) for other in others]
    return [at[2] + other.size_m[2] for other, at in places if np.hypot(at[0] - x, at[1] - y) < _NEAR_M]


def _clear_height_m(planner: MotionPlanner, kind: PartType, target: Pose) -> float:
    """TCP height at which the empty fingertips are above the part that was put down."""
    settings = planner.settings
    return target.position_m[2] + kind.size_m[2] + settings.gripper.fingertip_beyond_tcp_m + settings.approach_gap_m
