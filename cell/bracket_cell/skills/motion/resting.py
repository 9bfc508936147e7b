"""The poses in which the arm rests, where the bench's file does not give them: over the tray to look, and aside."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np

from bracket_cell.skills.motion.planner import Load, MotionPlanner
from bracket_cell.skills.motion.postures import misplaced_flange
from bracket_cell.skills.motion.settings import MotionSettings
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.pose import FINGERS_DOWN, Array, Pose
from bracket_ground.interfaces.product import Product

LOOKS_DOWN = (0.0, math.sqrt(0.5), math.sqrt(0.5), 0.0)  # of a camera whose image's right side is +y
TURNS = (0, 2, 1, 3)  # quarters of a turn of that camera, the usual one first
HIGHER = (1.06, 1.0, 1.15, 1.3, 1.5)  # times the height from which it just sees the whole tray
ASIDE_M = ((0.11, 0.12), (0.05, 0.10), (0.0, 0.0), (0.15, 0.0))  # of the tray's middle: away from person and bracket
PARK_HEIGHTS_M = (0.35, 0.30, 0.25, 0.40)
DIGITS = 4
Sight = Callable[[Array], bool]


def with_resting_poses(bench: Bench, product: Product, settings: MotionSettings, leaves_in_view: Sight) -> Bench:
    """The bench with those poses that its file leaves out.

    Args:
        leaves_in_view: whether the arm's points (links, k, 3) leave the bench to the overhead camera; where no pose
            aside does, it is the first one.

    Raises:
        ValueError: there is none in which the arm is free.
    """
    if bench.arm_look_rad and bench.arm_park_rad:
        return bench
    motion = MotionPlanner(product, bench, settings)
    found, outline = {}, motion.separation.outline

    def clear(joints_rad: Array) -> bool:
        return leaves_in_view(outline.corners_m(outline.placed(joints_rad[np.newaxis]))[0])

    if not bench.arm_look_rad:
        what = "arm_look_rad: in no posture of the arm does the wrist camera see the whole tray"
        found["arm_look_rad"] = _first(motion, look_poses(bench), what)
    if not bench.arm_park_rad:
        what = "arm_park_rad: the arm is free in no posture beside the tray"
        found["arm_park_rad"] = _first(motion, park_poses(bench), what, clear)
    return bench.model_copy(update=found)


def _first(motion: MotionPlanner, poses: Iterator[Pose], what: str, clear: Sight = lambda _: True) -> tuple[float, ...]:
    """Joints of the first pose that the arm reaches and in which it is free, and clear, if there is one."""
    usual, reason = motion.kinematics.usual_rad, ""
    first: tuple[float, ...] = ()
    for pose in poses:
        found = motion.reach([pose], usual, Load(motion.open_m))
        if not isinstance(found, str):
            inside = np.clip(found[1].round(DIGITS), *motion.kinematics.limits_rad)  # pi, rounded, is beyond pi
            first = first or tuple(inside.tolist())
            if clear(inside):
                return tuple(inside.tolist())
        else:
            reason = reason or str(found)
    if first:
        return first
    reason = "; ".join((reason, *misplaced_flange(motion.settings.robot)))
    raise ValueError(f"{what} ({reason}): move the tray, or lead the arm there with `cell setup teach`")


def look_poses(bench: Bench) -> Iterator[Pose]:
    """Of the tool, with the whole tray in the wrist camera's image."""
    (x, y, z), camera = bench.tray.centre_m, bench.wrist
    corners = np.array(
        [(x + i * bench.tray.size_m[0] / 2, y + j * bench.tray.size_m[1] / 2, z) for i in (-1, 1) for j in (-1, 1)]
    )
    for higher in HIGHER:
        for quarter in TURNS:
            turned = Pose.from_yaw((0.0, 0.0, 0.0), quarter * math.pi / 2) @ Pose((0.0, 0.0, 0.0), LOOKS_DOWN)
            seen_m = bench.tray.size_m if quarter % 2 else bench.tray.size_m[::-1]  # along the image's sides
            width_px, height_px = camera.width_px - 1, camera.height_px - 1
            height_m = higher * camera.focal_px * max(seen_m[0] / width_px, seen_m[1] / height_px)
            world_from_camera = Pose((x, y, z + height_m), turned.quaternion_wxyz)
            pixels = camera.model.project(world_from_camera, corners)
            if ((pixels >= 0) & (pixels <= (width_px, height_px))).all():
                yield world_from_camera @ camera.mount.pose.inverse()


def park_poses(bench: Bench) -> Iterator[Pose]:
    """Of the tool, away from bracket and person, the fingers down."""
    x, y, _ = bench.tray.centre_m
    away = math.copysign(1.0, y - bench.bracket.position_m[1])
    for height_m in PARK_HEIGHTS_M:
        for back_m, aside_m in ASIDE_M:
            for quarter in TURNS:
                place = (x - back_m, y + away * aside_m, height_m)
                yield Pose.from_yaw(place, quarter * math.pi / 2) @ FINGERS_DOWN
