"""Where the tool goes to grasp a part and to put it down, and whether fingers have room there."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from bracket_cell.skills.motion.collision import Box, body_box
from bracket_cell.skills.motion.settings import MotionSettings
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.grip import Grip, Hold
from bracket_ground.interfaces.gripper import Shape
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import PartType, Product

GIVES_WAY_M = 0.001  # fingers that hold stand so much closer than the part is wide (measured: 0.3 to 1.7 mm)
TOLERANCE_M, FITS_M = 0.0025, 0.0015  # of what is not known, and of what was seen
APART_M = 0.001  # two types that fit nearly as well cannot be told apart

_DOWN = Pose((0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0))


@dataclass(frozen=True)
class Grasp:
    """One way to hold a part.

    Attributes:
        hold: the sides that the fingers close on, and where.
        world_from_tool: the tool (TCP) when the fingers close.
        opening_m: opening with which the fingers come down.
        height_m: of the TCP above the body's bottom.
        close: with the least room for the fingers, so to be approached slowly.
    """

    hold: Hold
    world_from_tool: Pose
    opening_m: float
    height_m: float
    close: bool = False


def tool_down(position_m: Sequence[float], yaw_rad: float) -> Pose:
    """world_from_tool with the fingers straight down, opening along the heading `yaw_rad`."""
    return Pose.from_yaw(position_m, yaw_rad) @ _DOWN


def fingertips_m(kind: PartType, grip: Grip, settings: MotionSettings) -> float:
    """Height of the fingertips above a body's bottom: near the top of what they hold, never below the bottom."""
    return settings.gripper.tips_m(kind, grip, settings.grasp_depth_m, settings.fingertip_clearance_m)


def grasp_height_m(kind: PartType, grip: Grip, settings: MotionSettings) -> float:
    """Height of the TCP above a body's bottom."""
    return fingertips_m(kind, grip, settings) + settings.gripper.fingertip_beyond_tcp_m


def grip_of(kind: PartType, opening_m: float, settings: MotionSettings) -> Grip:
    """How a part is held, by the distance between the fingers; WIDTH where its sides are alike."""
    return min(settings.gripper.known, key=lambda grip: _off_m(kind, grip, opening_m, settings))


def held_type(product: Product, opening_m: float, settings: MotionSettings) -> str | None:
    """The only type that leaves the fingers so far apart; None where there is none, or more than one."""
    misfits = sorted((_misfit_m(kind, opening_m, settings), name) for name, kind in product.parts.items())
    (best_m, name), rest = misfits[0], misfits[1:]
    if best_m > TOLERANCE_M or (rest and rest[0][0] - best_m < APART_M):
        return None
    return name


def fits(kind: PartType, opening_m: float, settings: MotionSettings) -> bool:
    """Whether it may be a part of this type that leaves the fingers so far apart."""
    return _misfit_m(kind, opening_m, settings) <= FITS_M


def _misfit_m(kind: PartType, opening_m: float, settings: MotionSettings) -> float:
    grips = settings.gripper.known
    return min((_off_m(kind, grip, opening_m + GIVES_WAY_M, settings) for grip in grips), default=math.inf)


def _off_m(kind: PartType, grip: Grip, opening_m: float, settings: MotionSettings) -> float:
    """How much farther apart fingers are than on such a part; 0 where the opening tells nothing of it."""
    held_m = settings.gripper.held_m(kind, grip, fingertips_m(kind, grip, settings))
    return 0.0 if held_m is None else abs(held_m - opening_m)


def holds(kind: PartType, grip: Grip, settings: MotionSettings) -> tuple[Hold, ...]:
    """How a grip may hold a part: in the middle of its sides, and beside it where its shape allows that."""
    return settings.gripper.holds(kind, grip, fingertips_m(kind, grip, settings))


def grasps(
    part: PartDetection, kind: PartType, settings: MotionSettings, hold: Hold, *, close: bool = False
) -> tuple[Grasp, Grasp]:
    """Both ways to hold a part so, half a turn of the tool apart.

    Args:
        close: with the least gap between fingers and body instead of the usual one.
    """
    clearance_m = settings.least_finger_clearance_m if close else settings.finger_clearance_m
    opening = settings.gripper.opening_for(kind, hold.grip, clearance_m)
    height = grasp_height_m(kind, hold.grip, settings)
    first = _tool_pose(part.world_from_part, hold, height)
    second = _tool_pose(_half_turned(part.world_from_part), hold.turned, height)
    return Grasp(hold, first, opening, height, close), Grasp(hold.turned, second, opening, height, close)


def held_boxes(part: str, kind: PartType, settings: MotionSettings, hold: Hold, *, with_peg: bool) -> tuple[Box, ...]:
    """A grasped part in the tool frame: its body, and its peg where that must not touch either.

    Where it is not known where it is held, the boxes reach as far as any of that takes them.
    """
    height_m = grasp_height_m(kind, hold.grip, settings)
    tool_from_part = (Pose((0.0, 0.0, height_m)) @ hold.part_from_jaw @ _DOWN).inverse()
    more = np.zeros(3)
    more[1 - hold.grip.axis] = 2 * hold.unsure_m
    length, width, height = kind.size_m + more
    body = body_box(part, tool_from_part, (float(length), float(width), float(height)))
    if not with_peg:
        return (body,)
    middle = tool_from_part @ Pose((0.0, 0.0, -kind.peg_length_m / 2))
    x, y, z = np.array([kind.peg_diameter_m, kind.peg_diameter_m, kind.peg_length_m]) + more
    return body, Box(part, middle, (float(x), float(y), float(z)))


def hole_pose(product: Product, bench: Bench, position: str) -> Pose:
    """World pose of a part that sits in a hole: its length across the row of holes."""
    return bench.bracket.pose @ Pose(product.slot_m(position))


def place_poses(world_from_part: Pose, kind: PartType, settings: MotionSettings, hold: Hold) -> tuple[Pose, Pose]:
    """Both tool poses, half a turn apart, that let a held part go just above where it will rest."""
    height = grasp_height_m(kind, hold.grip, settings) + settings.release_gap_m
    return _tool_pose(world_from_part, hold, height), _tool_pose(_half_turned(world_from_part), hold, height)


def fingers_clear(grasp: Grasp, others: Sequence[PartDetection], settings: MotionSettings) -> bool:
    """Whether both fingers, as they come down and close, pass beside all other parts that reach up to them."""
    tool = grasp.world_from_tool
    lowest_m = tool.position_m[2] - settings.gripper.fingertip_beyond_tcp_m - settings.passing_gap_m
    margin_m = settings.least_finger_margin_m if grasp.close else settings.finger_margin_m
    high = [footprint(other) for other in others if other.world_from_part.position_m[2] + other.size_m[2] > lowest_m]
    fingers = _fingers(tool, settings.gripper.moving(grasp.opening_m).values())
    return all(gap_m(finger, other) >= margin_m for finger in fingers for other in high)


def footprint(part: PartDetection) -> Array:
    """Corners (4, 2) of a body seen from above."""
    return rectangle(
        np.array(part.world_from_part.position_m[:2]), part.world_from_part.yaw_rad, np.array(part.size_m[:2]) / 2
    )


def rectangle(centre_m: Array, yaw_rad: float, half_m: Array) -> Array:
    """Corners (4, 2) of a turned rectangle, in order around it."""
    signs = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    corners: Array = (signs * half_m) @ np.array([[c, s], [-s, c]]) + centre_m
    return corners


def gap_m(first: Array, second: Array) -> float:
    """Largest distance between two rectangles (4, 2) along any side direction; negative or 0 where they overlap."""
    sides = np.concatenate([first[:2] - first[1:3], second[:2] - second[1:3]])
    axes = sides / np.linalg.norm(sides, axis=1, keepdims=True)
    a, b = first @ axes.T, second @ axes.T
    return float(np.max(np.maximum(a.min(axis=0) - b.max(axis=0), b.min(axis=0) - a.max(axis=0))))


def _tool_pose(world_from_part: Pose, hold: Hold, height_m: float) -> Pose:
    """The tool that looks down on a part, the TCP this far above the body's bottom."""
    upright = Pose.from_yaw(world_from_part.position_m, world_from_part.yaw_rad)
    jaw = upright @ hold.part_from_jaw
    x, y, bottom = jaw.position_m
    return tool_down((x, y, bottom + height_m), jaw.yaw_rad)


def _half_turned(world_from_part: Pose) -> Pose:
    """An upright part called from its other end."""
    return Pose.from_yaw(world_from_part.position_m, world_from_part.yaw_rad - math.pi)


def _fingers(tool: Pose, boxes: Iterable[Shape]) -> list[Array]:
    """Corners (4, 2) of each finger seen from above."""
    yaw, at = tool.yaw_rad, np.array(tool.position_m[:2])
    ahead = np.array([math.cos(yaw), math.sin(yaw)])
    return [rectangle(at + centre[0] * ahead, yaw, np.array(size[:2]) / 2) for centre, size in boxes]
