"""Ways to hold a part that lies, so that the gripper can turn it by a quarter: onto its peg, or nearer to that.

The fingers close along one axis of the part, which is also the axis of the turn. They come down leaning to the side
that will be up, and lean to the other side afterwards, because a gripper that lies flat would touch the floor.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import product as all_of
from itertools import zip_longest

import numpy as np

from bracket_cell.skills.motion.collision import Box
from bracket_cell.skills.motion.settings import MotionSettings
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import PartType
from bracket_ground.interfaces.resting_pose import SIDES, UPRIGHT, axis_of, rest_on
from bracket_ground.interfaces.solid import Solid

LEANS_RAD = tuple(math.radians(angle) for angle in (40.0, 50.0, 30.0, 60.0))
MOST_LEAN_RAD = math.radians(66.0)  # of the tool, when it lets go
OVER_FLOOR_M = 0.018  # of the TCP, so that a leaning finger's corner stays clear of the floor
PAD_M = 0.009  # of the pads around the TCP that shall lie against the part
PLACE_STEP_M, MOST_PLACES = 0.005, 9  # from the middle on, along the side that will be up
CONTACT_M, REACHED_M = 5e-4, 0.003  # what is so little narrower touches the pads, too; it must be so near their middle


@dataclass(frozen=True)
class Turn:
    """A quarter turn.

    Attributes:
        axis: of the part, about which it is turned and along which the fingers close: 0, 1 or 2.
        up: the side that is up before.
        then: the side that is up afterwards.
    """

    axis: int
    up: str
    then: str


@dataclass(frozen=True)
class LyingHold:
    """How a part that lies is held.

    Attributes:
        turn: what the grasp is for.
        part_from_tool: the tool (TCP) in the part's frame.
        held_m: distance between the fingers.
    """

    turn: Turn
    part_from_tool: Pose
    held_m: float

    @property
    def sides(self) -> tuple[str, str]:
        """Those with which it can be put down, the one that the turn is for first."""
        return self.turn.then, self.turn.up

    def lean_rad(self, up: str) -> float:
        """How far the tool leans from the vertical when this side of the part is up."""
        return math.acos(min(1.0, max(-1.0, float(-self.part_from_tool.rotation[:, 2] @ axis_of(up)))))


@cache
def turns_left(kind: PartType, up: str, settings: MotionSettings) -> int | None:
    """How many quarter turns a part needs until it stands; None where the fingers cannot do it."""
    reached, left = {UPRIGHT}, 0
    while up not in reached:
        before = {
            turn.up
            for side in SIDES
            for turn in _turns(kind, side)
            if side not in reached and turn.then in reached and _possible(kind, turn, settings)
        }
        if not before:
            return None
        reached, left = reached | before, left + 1
    return left


@cache
def lying_holds(kind: PartType, up: str, settings: MotionSettings) -> tuple[LyingHold, ...]:
    """All ways to hold a part that lies: first those that bring it nearer to standing, of every lean one by turns."""
    left = turns_left(kind, up, settings)
    useful = [
        turn for turn in _turns(kind, up) if left is not None and turns_left(kind, turn.then, settings) == left - 1
    ]
    others = [turn for turn in _turns(kind, up) if turn not in useful]
    ways = [_holds(kind, turn, lean, settings) for lean, turn in all_of(LEANS_RAD, useful)]
    by_turns = [hold for row in zip_longest(*ways) for hold in row if hold is not None]
    return *by_turns, *(hold for turn in others for hold in _holds(kind, turn, LEANS_RAD[0], settings))


@cache
def straight_holds(kind: PartType, up: str, settings: MotionSettings) -> tuple[LyingHold, ...]:
    """Ways to hold a part from straight above the side that is up, to put it down as it lay; across by turns."""
    across = [axis for axis in range(3) if axis_of(up)[axis] == 0]
    turns = [Turn(axis, up, f"+{'xyz'[3 - axis - 'xyz'.index(up[1])]}") for axis in across]
    rows = zip_longest(*(_holds(kind, turn, 0.0, settings) for turn in turns))
    return tuple(hold for row in rows for hold in row if hold is not None)


def solid_boxes(name: str, kind: PartType, world_from_part: Pose) -> tuple[Box, ...]:
    """A part as it lies: a box around each of its solids."""
    return tuple(
        Box(f"{name} ({number})", world_from_part @ Pose(solid.centre_m), solid.size_m)
        for number, solid in enumerate(kind.whole)
    )


def held_box(name: str, kind: PartType, hold: LyingHold) -> Box:
    """The held part in the tool frame: one box around body and peg."""
    (length, width, height), peg = kind.size_m, kind.peg_length_m
    middle = hold.part_from_tool.inverse() @ Pose((0.0, 0.0, (height - peg) / 2))
    return Box(name, middle, (length, width, height + peg))


def laid_out(kind: PartType, up: str) -> tuple[Pose, tuple[float, float, float]] | None:
    """spot_from_part and the room (length, width, height) of a part that lies, around the spot; None: it tips over."""
    rest = rest_on(kind, up)
    if rest is None:
        return None
    points = rest.transform(np.concatenate([solid.points() for solid in kind.whole]))
    low, high = points.min(axis=0), points.max(axis=0)
    x, y, _ = (low + high) / 2
    length, width, height = (float(value) for value in high - low)
    return Pose((-float(x), -float(y), 0.0)) @ rest, (length, width, height)


@cache
def _turns(kind: PartType, up: str) -> tuple[Turn, ...]:
    """Quarter turns onto a side on which the part stays; across the width first."""
    stays = [side for side in (UPRIGHT, *SIDES) if rest_on(kind, side) is not None]
    across = [axis for axis in (1, 0, 2) if axis_of(up)[axis] == 0]
    return tuple(
        Turn(axis, up, then)
        for axis in across
        for then in stays
        if axis_of(then)[axis] == 0 and axis_of(then) @ axis_of(up) == 0
    )


@cache
def _possible(kind: PartType, turn: Turn, settings: MotionSettings) -> bool:
    """Whether the fingers can hold the part for a turn, somewhere."""
    return next(_holds(kind, turn, LEANS_RAD[0], settings), None) is not None


def _holds(kind: PartType, turn: Turn, lean_rad: float, settings: MotionSettings) -> Iterator[LyingHold]:
    """Ways to hold a part for one turn, the tool leaning so far, and both half turns of the tool."""
    if (fingers := settings.gripper.fingers) is None or kind.mass_kg > settings.gripper.payload_kg:
        return
    up, then = axis_of(turn.up), axis_of(turn.then)
    low, high = _reach(kind, up)
    usual = high - (settings.grasp_depth_m - settings.gripper.fingertip_beyond_tcp_m)
    depths = dict.fromkeys(max(depth, low + OVER_FLOOR_M) for depth in (usual, usual - PAD_M))
    low, high = _reach(kind, then)
    back = math.cos(lean_rad) * up + math.sin(lean_rad) * then
    for depth, along in all_of(depths, _places(_middle(kind, then), low + OVER_FLOOR_M, high)):
        point = depth * up + along * then
        span = _span(kind, turn, point)
        if span is None or span[1] - span[0] + 2 * settings.least_finger_clearance_m > fingers.stroke_m:
            continue
        point[turn.axis] = (span[0] + span[1]) / 2
        for side in (1.0, -1.0):
            opens = side * np.eye(3)[turn.axis]
            matrix = np.eye(4)
            matrix[:3, :3] = np.column_stack([opens, np.cross(-back, opens), -back])
            matrix[:3, 3] = point
            yield LyingHold(turn, Pose.from_matrix(matrix), span[1] - span[0])


def _places(middle_m: float, low_m: float, high_m: float) -> list[float]:
    """Places between two ends, from the one nearest to the middle on."""
    nearest = min(max(middle_m, low_m), high_m)
    found = [nearest + PLACE_STEP_M * step for step in range(-MOST_PLACES, MOST_PLACES + 1)]
    return sorted((at_m for at_m in found if low_m <= at_m <= high_m), key=lambda at_m: abs(at_m - nearest))


def _span(kind: PartType, turn: Turn, point: Array) -> tuple[float, float] | None:
    """What the pads close on around a place in the part's frame; None where one of them would touch beside it."""
    windows = {
        index: (float(point[index]) - PAD_M, float(point[index]) + PAD_M) for index in range(3) if index != turn.axis
    }
    found = [(solid, span) for solid in kind.whole if (span := solid.span_m(turn.axis, windows)) is not None]
    if not found:
        return None
    low, high = min(span[0] for _, span in found), max(span[1] for _, span in found)
    along = next(index for index in range(3) if axis_of(turn.then)[index] != 0)
    left = [solid for solid, span in found if span[0] < low + CONTACT_M]
    right = [solid for solid, span in found if span[1] > high - CONTACT_M]
    touched = _touches(left, along, float(point[along])) and _touches(right, along, float(point[along]))
    return (low, high) if touched else None


def _touches(solids: Sequence[Solid], axis: int, place_m: float) -> bool:
    """Whether solids lie against the middle of a pad, or on both sides of it."""
    ahead = min(solid.centre_m[axis] - solid.size_m[axis] / 2 for solid in solids)
    behind = max(solid.centre_m[axis] + solid.size_m[axis] / 2 for solid in solids)
    return ahead <= place_m + REACHED_M and behind >= place_m - REACHED_M


def _reach(kind: PartType, way: Array) -> tuple[float, float]:
    """How far body and peg reach along a way in the part's frame."""
    along = np.concatenate([solid.points() for solid in kind.whole]) @ way
    return float(along.min()), float(along.max())


def _middle(kind: PartType, way: Array) -> float:
    """The middle of the body's mass along a way."""
    volumes = np.array([solid.volume_m3 for solid in kind.solids])
    return float(volumes @ (np.array([solid.middle_m for solid in kind.solids]) @ way) / volumes.sum())
