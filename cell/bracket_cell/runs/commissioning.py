"""Sets up a cell by hand: places that are touched or led to, one checked motion, and the job above the bench."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property

import numpy as np

from bracket_cell.configuration import Configuration
from bracket_cell.runs.calibrating import DOWN
from bracket_cell.runs.slow_motion import move_to, next_frame, placed
from bracket_cell.skills.motion.planner import Load, MotionPlanner
from bracket_cell.wiring.detectors import part_finder
from bracket_ground.errors import InputError, counted
from bracket_ground.files.model import Location
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.devices import Devices
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import Product

POSES = {"park": "arm_park_rad", "look": "arm_look_rad"}
TOUCHED_OFF_M = 0.004  # touched points must lie to one another as those of the product within this
ASKEW_RAD = math.radians(2)  # of the tray's sides against the axes of the world
LEAST_SIDE_M = 0.05
DRY_M, DRY_SHARE = 0.12, 0.1  # of a dry run: above what would be touched; share of speed
DIGITS = 4  # of metres and radians in the configuration
Tell = Callable[[str], None]


class Teaching:
    """What is asked for at the bench, and what follows from it, for one name.

    Args:
        name: park, look, bracket, tray or a part type whose bin it is.

    Raises:
        InputError: there is no such thing.
    """

    def __init__(self, name: str, bench: Bench, product: Product, motion: MotionPlanner) -> None:
        legal = (*POSES, "bracket", "tray", *bench.bins_m)
        if name not in legal:
            raise InputError(f"cannot teach {name!r}; legal: {', '.join((*legal, 'gripper', 'robot', 'stop'))}")
        self._name, self._bench, self._product, self._motion = name, bench, product, motion

    @cached_property
    def prompts(self) -> tuple[str, ...]:
        """What somebody leads the arm to, one after the other, each followed by Enter."""
        touch = "touch with the closed fingertips "
        if self._name in POSES:
            return (f"lead the arm to the pose {self._name}",)
        if self._name == "bracket":
            return tuple(f"{touch}the plate's upper corner beside {hole}" for hole in self._corners)
        if self._name == "tray":
            sides = ("left and far from the arm", "right and far", "left and near", "right and near")
            return tuple(f"{touch}the floor of the tray in its corner {side}" for side in sides)
        return (f"{touch}the table in the middle of the bin of {self._name}",)

    def values(self, joints_rad: Sequence[Array]) -> tuple[dict[Location, object], str]:
        """What the configuration says from now on, by location, and what to tell of it.

        Args:
            joints_rad: (n,) for each prompt.

        Raises:
            InputError: the points cannot be those that were asked for.
        """
        if self._name in POSES:
            return self._pose(joints_rad[0])
        points = np.array([self._fingertip_m(joints) for joints in joints_rad])
        if self._name == "bracket":
            return self._bracket(points)
        return self._tray(points) if self._name == "tray" else self._bin(points[0])

    def _fingertip_m(self, joints_rad: Array) -> Array:
        beyond = self._motion.settings.gripper.fingertip_beyond_tcp_m
        return self._motion.kinematics.forward(joints_rad).transform(np.array([0.0, 0.0, beyond]))

    def _pose(self, joints_rad: Array) -> tuple[dict[Location, object], str]:
        """Joints at the turns nearest to the other pose: the way between them goes round nothing."""
        other = next(key for name, key in POSES.items() if name != self._name)
        near = np.array(getattr(self._bench, other) or joints_rad)
        joints = self._motion.kinematics.wrapped(joints_rad, near)
        turned = [
            name
            for name, joint, was in zip(self._motion.settings.robot.joints, joints, joints_rad, strict=True)
            if abs(joint - was) > 1
        ]
        text = f"; {', '.join(turned)} stored a whole turn nearer to the other pose" if turned else ""
        return {("bench", POSES[self._name]): _rounded(joints)}, f"{self._name}{text}"

    @cached_property
    def _corners(self) -> Mapping[str, tuple[float, float]]:
        """Three corners of the plate in its own frame, by the hole nearest to each."""
        bracket = self._product.bracket
        holes = np.array(list(bracket.holes_m.values()))
        low, high = holes.min(axis=0) - bracket.margin_m, holes.max(axis=0) + bracket.margin_m
        found: dict[str, tuple[float, float]] = {}
        for x, y in ((low[0], low[1]), (high[0], low[1]), (low[0], high[1])):
            order = np.argsort(np.hypot(*(holes - (x, y)).T))
            names = [list(bracket.holes_m)[index] for index in order]
            found[next(name for name in names if name not in found)] = float(x), float(y)
        return found

    def _bracket(self, points_m: Array) -> tuple[dict[Location, object], str]:
        wanted = np.array([(*corner, 0.0) for corner in self._corners.values()])
        pose, off_m = fitted(wanted, points_m)
        if off_m > TOUCHED_OFF_M:
            raise InputError(
                f"the corners that were touched lie {1e3 * off_m:.0f} mm otherwise to one another than the product's "
                f"plate has them, limit {1e3 * TOUCHED_OFF_M:.0f} mm: touch them again, in the order asked for"
            )
        values: dict[Location, object] = {
            ("bench", "bracket"): {
                "position_m": _rounded(pose.position_m),
                "quaternion_wxyz": [round(float(value), 6) for value in pose.quaternion_wxyz],
            }
        }
        return values, f"bracket at ({', '.join(map(str, _rounded(pose.position_m)))}), {1e3 * off_m:.1f} mm off"

    def _tray(self, points_m: Array) -> tuple[dict[Location, object], str]:
        far_left, far_right, near_left, near_right = points_m[:, :2]
        along = [far_left - near_left, far_right - near_right]
        across = [far_right - far_left, near_right - near_left]
        x_m, y_m = (float(np.mean([np.linalg.norm(edge) for edge in side])) for side in (along, across))
        askew = max(_askew(edge, axis) for side, axis in ((along, 0), (across, 1)) for edge in side)
        if min(x_m, y_m) < LEAST_SIDE_M or askew > ASKEW_RAD:
            raise InputError(
                f"the tray's sides are {1e3 * x_m:.0f} and {1e3 * y_m:.0f} mm long and {math.degrees(askew):.1f} "
                f"degrees askew to the arm's base; they must be {1e3 * LEAST_SIDE_M:.0f} mm or more, and within "
                f"{math.degrees(ASKEW_RAD):.0f} degrees: turn the tray, or touch its corners again"
            )
        middle = _rounded(points_m.mean(axis=0))
        size = _rounded([x_m, y_m])
        values: dict[Location, object] = {("bench", "tray", "centre_m"): middle, ("bench", "tray", "size_m"): size}
        return values, f"tray at ({', '.join(map(str, middle))}), {1e3 * x_m:.0f} by {1e3 * y_m:.0f} mm"

    def _bin(self, point_m: Array) -> tuple[dict[Location, object], str]:
        place = _rounded(point_m)
        return {("bench", "bins_m", self._name): place}, f"bin of {self._name} at ({', '.join(map(str, place))})"


def fitted(wanted_m: Array, touched_m: Array) -> tuple[Pose, float]:
    """The rigid transform that brings points (n, 3) to others, and how far one is off then (Kabsch, 1976)."""
    middles = wanted_m.mean(axis=0), touched_m.mean(axis=0)
    left, _, right = np.linalg.svd((wanted_m - middles[0]).T @ (touched_m - middles[1]))
    sign = np.sign(np.linalg.det(right.T @ left.T))
    rotation = right.T @ np.diag([1.0, 1.0, sign]) @ left.T
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, middles[1] - rotation @ middles[0]
    pose = Pose.from_matrix(matrix)
    return pose, float(np.linalg.norm(pose.transform(wanted_m) - touched_m, axis=1).max())


def way_to(name: str, devices: Devices, bench: Bench, motion: MotionPlanner) -> str:
    """What a motion to a named pose would be, in words.

    Raises:
        InputError: there is no such pose, or no free way there.
    """
    here, goal = np.array(devices.arm.state().positions_rad), goal_of(name, bench)
    way = motion.free_move(here, goal, Load(motion.open_m))
    if isinstance(way, str):
        raise InputError(f"no way to {name}: {way}")
    far = np.abs(way.positions_rad[-1] - way.positions_rad[0])
    joint = int(far.argmax())
    turns = f"{motion.settings.robot.joints[joint]} turns by {math.degrees(float(far[joint])):.0f} degrees"
    return f"{turns}, {way.duration_s:.1f} s at full speed"


def goal_of(name: str, bench: Bench) -> Array:
    """Joints of a named pose; raises InputError where there is none."""
    if name not in POSES:
        raise InputError(f"no pose {name!r}; legal: {', '.join(POSES)}")
    return np.array(getattr(bench, POSES[name]))


def dry_run(configuration: Configuration, product: Product, devices: Devices, tell: Tell) -> int:
    """Look into the tray, then go above each part that is seen and above each hole, and touch nothing.

    Returns:
        how many places could not be reached.

    Raises:
        DeviceFault: a device gave up.
    """
    bench, motion = configuration.bench, MotionPlanner(product, configuration.bench, configuration.motion)
    find = part_finder(bench, product, configuration.perception)
    move_to(devices, motion, goal_of("look", bench), DRY_SHARE)
    tell("over the tray")
    frame = next_frame(devices.wrist, devices.clock)
    seen = find(placed(frame, devices, motion)).detections
    tell(f"{counted(len(seen), 'part')} seen" if seen else "no part in the tray: put some there, or look at the light")
    bracket = bench.bracket.pose
    holes = {f"hole {name}": bracket.transform(np.array([*at, 0.0])) for name, at in product.bracket.holes_m.items()}
    missed = 0
    for what, place in (*((f"part {detection.part}", _top_m(detection)) for detection in seen), *holes.items()):
        reached = motion.reach(_above(place), np.array(devices.arm.state().positions_rad), Load(motion.open_m))
        if isinstance(reached, str):
            missed += 1
            tell(f"{what}: {reached}")
            continue
        move_to(devices, motion, reached[1], DRY_SHARE)
        tell(f"above {what}")
    move_to(devices, motion, goal_of("park", bench), DRY_SHARE)
    return missed


def _top_m(part: PartDetection) -> Array:
    place = np.array(part.world_from_part.position_m)
    place[2] += part.size_m[2]
    return place


def _above(place_m: Array) -> list[Pose]:
    """Tool poses above a place that look down, by quarters of a turn."""
    x, y, z = (float(value) for value in place_m)
    return [Pose.from_yaw((x, y, z + DRY_M), quarter * math.pi / 2) @ DOWN for quarter in range(4)]


def _askew(side: Array, axis: int) -> float:
    """Angle between a side and an axis of the world."""
    return float(math.atan2(abs(side[1 - axis]), abs(side[axis])))


def _rounded(values: Sequence[float] | Array) -> list[float]:
    return [round(float(value), DIGITS) for value in values]
