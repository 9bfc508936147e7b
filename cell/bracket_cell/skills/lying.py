"""Taking a part that lies, and putting it down again: upright, or on a side from which it is nearer to standing."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import product as all_of

from bracket_cell.skills.grasping.contact import RESTS_M, Descend, SetDown
from bracket_cell.skills.grasping.handling import (
    bracket_boxes,
    carry_over_bracket_m,
    joints_of,
    release_phases,
    seen_in_holes,
    slips_m,
    tray_boxes,
    why_not_empty,
)
from bracket_cell.skills.grasping.phases import Activate, Move, Phase, PhasedSkill
from bracket_cell.skills.grasping.take_lower import TakeLower
from bracket_cell.skills.motion.collision import Box, part_box
from bracket_cell.skills.motion.lying_grasp import (
    MOST_LEAN_RAD,
    OVER_FLOOR_M,
    LyingHold,
    held_box,
    laid_out,
    lying_holds,
    solid_boxes,
    straight_holds,
    turns_left,
)
from bracket_cell.skills.motion.motions import FreeWay, Line, Rise
from bracket_cell.skills.motion.planner import Load, MotionPlanner, at_height
from bracket_cell.skills.motion.settings import MotionSettings
from bracket_cell.skills.move_aside import free_centres
from bracket_ground.files.words.message import Message
from bracket_ground.interfaces.observation import Observation
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import PartType
from bracket_ground.interfaces.resting_pose import SIDES, UPRIGHT, lies_raised, side_up

HEADINGS = tuple(math.pi / 4 * turn for turn in range(8))  # of a part that is put down: the tool leans another way
LEANING_M = 0.012  # a leaning finger's corner is so much lower than its middle
DROP_M = 0.0025  # a part is let go this far above the floor: how it lay was not seen exactly
WIDE_M = 0.014  # by which fingers open wider for what lies on others, whose pose is known less well; where they can
UNSURE_M = 0.03  # how much higher than thought a part may hang between the fingers that was taken off others
STEPS = 2  # down, where the fingers close above a part that lies on others
TRIES, LIFTS = 64, 24  # ways to hold that are tried, leaning and straight

Chosen = tuple[LyingHold, Pose, Array]  # how, the tool (TCP) in the world, and the joints (n,) for it


@dataclass(eq=False)
class _OfLying(PhasedSkill):
    """Base of what is done with a part that lies.

    Attributes:
        part: it lies, and it is known how (`lies`).
        others: all other parts seen in the tray.
    """

    planner: MotionPlanner = field(repr=False)
    part: PartDetection
    others: Sequence[PartDetection]


@dataclass(eq=False)
class SetUpright(_OfLying):
    """Take a part that lies and stand it on its peg where the tray is free, or lay it on a side nearer to that."""

    _then: str = field(default="", init=False)

    def prepare(self, observation: Observation) -> Sequence[Phase] | str:
        """A grasp from which the part can be put down better than it lies now."""
        planner, part = self.planner, self.part
        if part.lies is None:
            return Message("cannot take {part}: it is not clear how it lies", part=part.part)
        sides = better(planner.product.parts[part.part], side_up(part.lies), planner.settings)
        ways = grasps_of_lying(planner, part, self.others, joints_of(observation))
        useful = (way for way in ways if way[0].turn.then in sides)
        found = taken_elsewhere(planner, part, self.others, observation, useful, lambda hold: (hold.turn.then,))
        if isinstance(found, str):
            return found
        self._then = found[0].turn.then
        return found[1]

    @property
    def done(self) -> str:
        """What the skill has achieved, in words."""
        return (
            Message("{part} was let go upright", part=self.part.part)
            if self._then == UPRIGHT
            else Message("{part} was let go on another side", part=self.part.part)
        )


@dataclass(eq=False)
class PickLying(_OfLying):
    """Take a part that lies and lift it, to hand it over; it stays as it is held."""

    def prepare(self, observation: Observation) -> Sequence[Phase] | str:
        """Any grasp that the arm reaches."""
        planner, part = self.planner, self.part
        if part.lies is None:
            return Message("cannot take {part}: it is not clear how it lies", part=part.part)
        if (full := why_not_empty(observation)) is not None:
            return Message("cannot take {part}: {full}", part=part.part, full=full)
        for chosen in grasps_of_lying(planner, part, self.others, joints_of(observation)):
            phases = take_lying(planner, part, self.others, chosen)
            if not isinstance(phases, str):
                return phases
        return Message("cannot take {part} as it lies: no room for the fingers", part=part.part)

    @property
    def done(self) -> str:
        """What the skill has achieved, in words."""
        return Message("holding {part} as it lay", part=self.part.part)


@dataclass(eq=False)
class LayAside(_OfLying):
    """Take a part as it lies, on others perhaps, and lay it down where the tray is free (Alg. 2, "move b")."""

    def prepare(self, observation: Observation) -> Sequence[Phase] | str:
        """A grasp with which the part can be put down on the side on which it lies, or on another one."""
        ways = ways_to_lift(self.planner, self.part, self.others, joints_of(observation))
        found = taken_elsewhere(self.planner, self.part, self.others, observation, ways, lambda hold: hold.sides)
        return found if isinstance(found, str) else found[1]

    @property
    def done(self) -> str:
        """What the skill has achieved, in words."""
        return Message("{part} moved aside", part=self.part.part)


def taken_elsewhere(
    planner: MotionPlanner,
    part: PartDetection,
    others: Sequence[PartDetection],
    observation: Observation,
    ways: Iterator[Chosen],
    sides: Callable[[LyingHold], Sequence[str]],
) -> tuple[LyingHold, list[Phase]] | str:
    """Phases that take a part as it lies and put it down where the tray is free, and how it is held meanwhile.

    Args:
        ways: to hold it.
        sides: with one of which up it is put down, by how it is held.
    """
    if (full := why_not_empty(observation)) is not None:
        return Message("cannot take {part}: {full}", part=part.part, full=full)
    reason: str = Message("cannot take {part} as it lies: no room for the fingers", part=part.part)
    for chosen in ways:
        hold, tool, joints = chosen
        take = take_lying(planner, part, others, chosen)
        lifted = planner.kinematics.follow(at_height(tool, lifted_m(planner, part, tool)), joints)
        if isinstance(take, str) or lifted is None:
            missed = Message("cannot lift {part}: out of the arm's reach", part=part.part)
            reason = take if isinstance(take, str) else missed
            continue
        unsure_m = UNSURE_M if raised(planner, part) else 0.0
        put = put_lying(planner, part.part, hold, observation, others, sides(hold), lifted, unsure_m)
        if not isinstance(put, str):
            return hold, [*take, *put]
        reason = put
    return reason


def why_not_lifted(
    planner: MotionPlanner, part: PartDetection, others: Sequence[PartDetection], near_rad: Array
) -> str | None:
    """Why the arm cannot take a part as it lies, or None where it can."""
    if part.lies is None:
        return Message("cannot take {part}: it is not clear how it lies", part=part.part)
    if next(ways_to_lift(planner, part, others, near_rad), None) is None:
        return Message("cannot take {part} as it lies: no room for the fingers", part=part.part)
    return None


def ways_to_lift(
    planner: MotionPlanner, part: PartDetection, others: Sequence[PartDetection], near_rad: Array
) -> Iterator[Chosen]:
    """Ways to take a part as it lies, on others perhaps: from straight above first."""
    assert part.lies is not None
    kind, up = planner.product.parts[part.part], side_up(part.lies)
    straight = straight_holds(kind, up, planner.settings)[:LIFTS]
    holds = [replace(hold, held_m=hold.held_m + wide) for hold, wide in all_of(straight, (WIDE_M, 0.0))]
    yield from _reached(planner, part, others, holds, near_rad)
    yield from grasps_of_lying(planner, part, others, near_rad)


def better(kind: PartType, up: str, settings: MotionSettings) -> tuple[str, ...]:
    """Sides from which a part needs fewer turns than from this one, the best first."""
    found = {side: turns_left(kind, side, settings) for side in (UPRIGHT, *SIDES)}
    left = {side: turns for side, turns in found.items() if turns is not None}
    return tuple(side for side in sorted(left, key=left.__getitem__) if up in left and left[side] < left[up])


def grasps_of_lying(
    planner: MotionPlanner, part: PartDetection, others: Sequence[PartDetection], near_rad: Array
) -> Iterator[Chosen]:
    """Ways to take a part that lies, which the arm reaches without touching anything, the best first."""
    assert part.lies is not None
    holds = lying_holds(planner.product.parts[part.part], side_up(part.lies), planner.settings)[:TRIES]
    yield from _reached(planner, part, others, holds, near_rad)


def _reached(
    planner: MotionPlanner,
    part: PartDetection,
    others: Sequence[PartDetection],
    holds: Sequence[LyingHold],
    near_rad: Array,
) -> Iterator[Chosen]:
    """Of the ways to hold a part that lies those that the arm reaches without touching anything, with the joints."""
    assert part.lies is not None
    itself = solid_boxes(part.part, planner.product.parts[part.part], part.lies)
    obstacles = (*boxes_around(planner, part, others), *itself)
    for hold in holds:
        tool = part.lies @ hold.part_from_tool
        found = planner.reach([tool], near_rad, Load(_opening_m(planner, hold), obstacles, close=True))
        if not isinstance(found, str):
            yield hold, *found


def raised(planner: MotionPlanner, part: PartDetection) -> bool:
    """Whether a part lies on others: on such as are seen, or higher than it would on the floor."""
    if part.lies is None or part.lies_on:
        return bool(part.lies_on)
    return lies_raised(planner.product.parts[part.part], part.lies, planner.bench.tray.centre_m[2])


def boxes_around(planner: MotionPlanner, part: PartDetection, others: Sequence[PartDetection]) -> tuple[Box, ...]:
    """Seen parts as obstacles for who takes a part that lies.

    What carries it counts as it lies where that is known; where not, it is as high as it can be, but not higher than
    the middle of what it carries.
    """
    if part.lies is None or not part.lies_on:
        return tray_boxes(planner, others)
    middle_m = float(part.lies.position_m[2]) - planner.bench.tray.centre_m[2]
    found: list[Box] = []
    for number, other in enumerate(others):
        name, carries = f"{other.part} in the tray ({number})", other.box_px in part.lies_on and not other.upright
        if carries and other.lies is not None:
            found += solid_boxes(name, planner.product.parts[other.part], other.lies)
            continue
        length, width, height = other.size_m
        lower = replace(other, size_m=(length, width, min(height, middle_m))) if carries else other
        found.append(part_box(lower, planner.product, name))
    return tuple(found)


def lifted_m(planner: MotionPlanner, part: PartDetection, tool: Pose) -> float:
    """Height of a tool that has lifted a part: over the bracket, and off what the part lay on, however high that is."""
    kind = planner.product.parts[part.part]
    off_m = tool.position_m[2] + kind.peg_length_m + planner.settings.carry_gap_m
    return max(carry_over_bracket_m(planner, kind), off_m)


def take_lying(
    planner: MotionPlanner, part: PartDetection, others: Sequence[PartDetection], chosen: Chosen
) -> list[Phase] | str:
    """Phases that end with the part held as it lay, lifted."""
    assert part.lies is not None
    hold, tool, joints = chosen
    carry_m = lifted_m(planner, part, tool)
    settings, name, kind = planner.settings, part.part, planner.product.parts[part.part]
    boxes, itself = boxes_around(planner, part, others), solid_boxes(part.part, kind, part.lies)
    opening_m = _opening_m(planner, hold)
    tops = [other.world_from_part.position_m[2] + other.size_m[2] for other in (part, *others)]
    over_m = (
        max(*tops, tool.position_m[2]) + settings.gripper.fingertip_beyond_tcp_m + settings.approach_gap_m + LEANING_M
    )
    above = planner.kinematics.follow(at_height(tool, over_m), joints)
    if above is None:
        return Message("cannot take {name}: out of the arm's reach above it", name=name)
    on_way, around = Load(opening_m, (*boxes, *itself)), Load(opening_m, (*boxes, *itself), close=True)
    if isinstance(way := planner.straight_move(above, tool, around), str):
        return Message("cannot take {name}: {way}", name=name, way=way)
    if isinstance(up := planner.rise(joints, carry_m, opening_m), str):
        return Message("cannot lift {name}: {up}", name=name, up=up)
    lowest_m, on_others = planner.bench.tray.centre_m[2] + OVER_FLOOR_M, raised(planner, part)
    slowly_m_s = settings.close_speed_m_s if on_others else None
    planner.hold, planner.lying = None, hold
    return [
        Activate(),
        Descend(name, planner, above, on_way, Line(planner, tool, around, slowly_m_s), feels=True),
        TakeLower(name, planner, opening_m, lowest_m, STEPS if on_others else 0),
        Move(Message("lifting {name}", name=name), Rise(planner, carry_m, opening_m), holding=name),
    ]


def put_lying(
    planner: MotionPlanner,
    name: str,
    hold: LyingHold,
    observation: Observation,
    others: Sequence[PartDetection],
    sides: Sequence[str],
    near_rad: Array,
    unsure_m: float = 0.0,
) -> list[Phase] | str:
    """Phases that put the held part down in the tray, with one of these sides up, the first that there is room for.

    Args:
        unsure_m: as in `put_at`.
    """
    kind, tray = planner.product.parts[name], planner.bench.tray
    reason: str = Message("no free spot in the tray for {name}", name=name)
    for up in sides:
        lies = laid_out(kind, up)
        if lies is None or hold.lean_rad(up) > MOST_LEAN_RAD:
            continue
        spot_from_part, room = lies
        for x, y, yaw in free_centres(room, tray.centre_m[:2], HEADINGS, others, tray, planner.settings, each=2):
            spot = Pose.from_yaw((x, y, tray.centre_m[2] + DROP_M), yaw)
            phases = put_at(
                planner, name, hold, spot @ spot_from_part, observation, others, near_rad, slips_m(kind), unsure_m
            )
            if not isinstance(phases, str):
                return phases
            reason = phases
    return reason


def put_lying_back(
    planner: MotionPlanner, name: str, observation: Observation, others: Sequence[PartDetection]
) -> list[Phase] | str:
    """Phases that put a part back into the tray that is held as it lay: as near to standing as the hold allows."""
    hold = planner.lying
    assert hold is not None
    return put_lying(planner, name, hold, observation, others, hold.sides, joints_of(observation))


def put_lying_down(
    planner: MotionPlanner, name: str, world_from_spot: Pose, observation: Observation, others: Sequence[PartDetection]
) -> list[Phase] | str:
    """Phases that put a part down on a spot that is held as it lay: as near to standing as the hold allows."""
    hold = planner.lying
    assert hold is not None
    reason: str = Message("cannot put {name} there", name=name)
    for up, turn in all_of(hold.sides, HEADINGS):
        found = laid_out(planner.product.parts[name], up)
        if found is None or hold.lean_rad(up) > MOST_LEAN_RAD:
            continue
        target = world_from_spot @ Pose.from_yaw((0.0, 0.0, DROP_M), turn) @ found[0]
        phases = put_at(planner, name, hold, target, observation, others, joints_of(observation))
        if not isinstance(phases, str):
            return phases
        reason = phases
    return reason


def put_at(
    planner: MotionPlanner,
    name: str,
    hold: LyingHold,
    world_from_part: Pose,
    observation: Observation,
    others: Sequence[PartDetection],
    near_rad: Array,
    slipped_m: float = RESTS_M,
    unsure_m: float = 0.0,
) -> list[Phase] | str:
    """Phases that let the held part go at a pose and end with the empty fingers above it.

    Args:
        slipped_m: as in `SetDown`.
        unsure_m: it may hang so much higher between the fingers: the way down is felt, as far as the floor lets them.
    """
    kind = planner.product.parts[name]
    obstacles = (*bracket_boxes(planner, seen_in_holes(observation)), *tray_boxes(planner, others))
    held, opening_m = (held_box(name, kind, hold),), _opening_m(planner, hold)
    carrying, lowering = Load(opening_m, obstacles, held), Load(opening_m, obstacles, close=True)
    tool = world_from_part @ hold.part_from_tool
    lowest_m = planner.bench.tray.centre_m[2] + OVER_FLOOR_M
    tool = at_height(tool, max(tool.position_m[2] - unsure_m, min(lowest_m, tool.position_m[2])))
    found = planner.reach([tool], near_rad, lowering)
    if isinstance(found, str):
        return Message("cannot put {name} there: {found}", name=name, found=found)
    carry_m = max(carry_over_bracket_m(planner, kind), tool.position_m[2])
    above = planner.kinematics.follow(at_height(tool, carry_m), found[1])
    if above is None:
        return Message("cannot put {name} there: out of the arm's reach above it", name=name)
    for way in (planner.near_move(near_rad, above, carrying), planner.straight_move(above, tool, lowering)):
        if isinstance(way, str):
            return Message("cannot put {name} there: {way}", name=name, way=way)
    down = Line(planner, tool, lowering, planner.settings.close_speed_m_s if unsure_m > 0 else None)
    return [
        Move(Message("turning {name}", name=name), FreeWay(planner, above, carrying), holding=name),
        SetDown(name, down, slipped_m + unsure_m),
        *release_phases(planner, name, opening_m, carry_m),
    ]


def _opening_m(planner: MotionPlanner, hold: LyingHold) -> float:
    return planner.settings.gripper.within(hold.held_m + 2 * planner.settings.finger_clearance_m)
