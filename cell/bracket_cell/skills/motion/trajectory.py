"""Joint trajectories within the datasheet's limits: straight in joint space, or straight for the tool (ruckig)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import ruckig

from bracket_cell.skills.motion.kinematics import Kinematics
from bracket_cell.skills.motion.settings import MotionSettings
from bracket_ground.interfaces.command import JointTrajectory
from bracket_ground.interfaces.pose import Array, Pose

CORNERS = (1.0, 0.75, 0.5, 0.4, 0.3, 0.15)  # shares of the shorter of two motions that a corner takes of the second
ROUNDING = 1e-6
EARLIER = (1, 2, 3)  # times as long as of the second it takes of the first
STRAIGHT = 0.6  # of the first, at most
LEGAL = 1.01  # of a limit, as differences of samples tell it
_STANDING_RAD = 1e-6  # a shorter way is no way
_SLOWDOWN_TRIES = 6
_LARGEST_STEP_RAD = 0.35  # between neighbouring samples of a line; more means a jump to another arm posture


def joint_move(start_rad: Array, goal_rad: Array, settings: MotionSettings) -> JointTrajectory:
    """From rest to rest on a straight line in joint space, all joints in phase.

    One profile from 0 to 1 drives all joints: ruckig's own phase synchronisation gives up the straight line where
    the slowest joint's profile would break another joint's limits.
    """
    way = goal_rad - start_rad
    largest = np.abs(way).max()
    if largest < _STANDING_RAD:
        return JointTrajectory(np.zeros(1), np.array(goal_rad, dtype=float)[None])
    share = np.abs(way).clip(min=largest * 1e-9)
    times, shares = _profile(
        1.0,
        float(np.min(np.array(settings.speed_limits_rad_s) / share)),
        float(np.min(np.array(settings.acceleration_limits_rad_s2) / share)),
        float(np.min(np.array(settings.jerk_limits_rad_s3) / share)),
        settings.sample_s,
    )
    positions = start_rad + shares[:, None] * way
    positions[-1] = goal_rad
    return JointTrajectory(times, positions)


def line_move(
    kinematics: Kinematics, start_rad: Array, world_from_goal: Pose, settings: MotionSettings
) -> JointTrajectory | None:
    """From rest to rest, the tool on a straight line, its heading turning along; None where the arm cannot follow.

    Speed, acceleration and jerk along the line are lowered until every joint keeps its limits.
    """
    start = kinematics.forward(start_rad)
    length = float(np.linalg.norm(np.subtract(world_from_goal.position_m, start.position_m)))
    if length < 1e-5:
        goal = kinematics.follow(world_from_goal, start_rad)
        return None if goal is None else joint_move(start_rad, goal, settings)
    limits = np.array([settings.line_speed_m_s, settings.line_acceleration_m_s2, settings.line_jerk_m_s3])
    for _ in range(_SLOWDOWN_TRIES):
        speed, acceleration, jerk = limits.tolist()
        times, way = _profile(length, speed, acceleration, jerk, settings.sample_s)
        positions = _follow_line(kinematics, start_rad, start, world_from_goal, way / length)
        if positions is None:
            return None
        ratios = limit_ratios(times, positions, settings)
        if ratios.max() <= 1.0:
            return JointTrajectory(times, positions)
        limits *= np.where(ratios > 1.0, 0.95 / ratios, 1.0)
    return None


def joint_speeds(times_s: Array, positions_rad: Array) -> Array:
    """Joint speeds (n - 1, 6) in [rad/s] between samples."""
    speeds: Array = np.diff(positions_rad, axis=0) / np.diff(times_s)[:, None]
    return speeds


def limit_ratios(times_s: Array, positions_rad: Array, settings: MotionSettings) -> Array:
    """Largest ratios (3,) of a joint's speed, acceleration and jerk between samples to their limits."""
    limits = settings.speed_limits_rad_s, settings.acceleration_limits_rad_s2, settings.jerk_limits_rad_s3
    rates, ratios = joint_speeds(times_s, positions_rad), []
    for limit in limits:
        ratios.append(np.abs(rates / np.array(limit)).max(initial=0.0))
        rates = np.diff(rates, axis=0) / settings.sample_s
    return np.array(ratios)


def joined(legs: Sequence[JointTrajectory]) -> JointTrajectory:
    """One trajectory out of legs that each start where the last one ends."""
    times, positions, offset = [np.zeros(1)], [legs[0].positions_rad[:1]], 0.0
    for leg in legs:
        times.append(leg.times_s[1:] + offset)
        positions.append(leg.positions_rad[1:])
        offset += leg.duration_s
    return JointTrajectory(np.concatenate(times), np.concatenate(positions))


def rounded(
    first: JointTrajectory,
    second: JointTrajectory,
    settings: MotionSettings,
    is_free: Callable[[Array], bool],
    most: float = 1.0,
) -> tuple[JointTrajectory, float]:
    """Two motions without a stop between them, and from when on nothing but the second is followed [s].

    The soonest corner that is free, of a few: from before the end of the first to behind the beginning of the second.

    Args:
        second: starts where the first ends, at rest.
        is_free: whether a path (k, n) touches nothing, and is within the joints' range.
        most: share of the shorter of them that the corner takes of the second at most.
    """
    before, behind = first.positions_rad, second.positions_rad
    longest = min(len(before), len(behind)) - 1
    steps = {int(share * longest) for share in CORNERS if share <= most} - {0, 1}
    ends = {(min(times * step, int(STRAIGHT * len(before))), step) for step in steps for times in EARLIER}
    corners = [(end, corner) for end in ends if (corner := _corner(before, behind, *end, settings)) is not None]
    for (early, late), corner in sorted(corners, key=lambda one: (len(one[1]) - sum(one[0]), one[0])):
        path = np.concatenate([before[:-early], corner[1:-1], behind[late:]])
        times_s: Array = settings.sample_s * np.arange(len(path), dtype=np.float64)
        within = limit_ratios(times_s, path, settings).max() <= LEGAL
        if len(corner) < early + late and within and is_free(corner):
            return JointTrajectory(times_s, path), float(times_s[len(path) - len(behind) + late])
    return joined([first, second]), first.duration_s


def _corner(before_rad: Array, behind_rad: Array, early: int, late: int, settings: MotionSettings) -> Array | None:
    """The soonest way (k, n) within the limits from so many samples before an end to so many behind a beginning."""
    request = ruckig.InputParameter(before_rad.shape[1])
    states = _state(before_rad, len(before_rad) - 1 - early, settings), _state(behind_rad, late, settings)
    request.current_position, request.current_velocity, request.current_acceleration = states[0]
    request.target_position, request.target_velocity, request.target_acceleration = states[1]
    limits = settings.speed_limits_rad_s, settings.acceleration_limits_rad_s2, settings.jerk_limits_rad_s3
    request.max_velocity, request.max_acceleration, request.max_jerk = (np.array(limits) * (1 + ROUNDING)).tolist()
    found = ruckig.Trajectory(before_rad.shape[1])
    for _ in range(2):  # the second time it takes whole samples
        try:
            ruckig.Ruckig(before_rad.shape[1]).calculate(request, found)
        except ruckig.RuckigError:  # at the place where it would go over, a joint is about to be too fast
            return None
        count = math.ceil(found.duration / settings.sample_s - ROUNDING)
        request.minimum_duration = count * settings.sample_s
    return np.array([found.at_time(number * settings.sample_s)[0] for number in range(count + 1)])


def _state(path_rad: Array, at: int, settings: MotionSettings) -> tuple[list[float], list[float], list[float]]:
    """Place, speed and acceleration of joints at a sample, exact where the jerk is even around it."""
    a, b, c, d, e = path_rad[np.clip(np.arange(at - 2, at + 3), 0, len(path_rad) - 1)]
    speeds = (8 * (d - b) - (e - a)) / (12 * settings.sample_s)
    return c.tolist(), speeds.tolist(), ((b - 2 * c + d) / settings.sample_s**2).tolist()


def _follow_line(kinematics: Kinematics, start_rad: Array, start: Pose, goal: Pose, shares: Array) -> Array | None:
    """Joints (k, n) at shares 0..1 of the straight way."""
    rows = [np.array(start_rad, dtype=float)]
    for share in shares[1:]:
        joints = kinematics.follow(_between(start, goal, float(share)), rows[-1])
        if (
            joints is None
            or np.abs(joints - rows[-1]).max() > _LARGEST_STEP_RAD
            or not kinematics.within_limits(joints)
        ):
            return None
        rows.append(joints)
    return np.array(rows)


def _between(start: Pose, goal: Pose, share: float) -> Pose:
    """Pose at a share of the way: position linear, orientation along the shorter arc (nlerp)."""
    position = (1 - share) * np.array(start.position_m) + share * np.array(goal.position_m)
    first, second = np.array(start.quaternion_wxyz), np.array(goal.quaternion_wxyz)
    if first @ second < 0:
        second = -second
    turned = (1 - share) * first + share * second
    w, x, y, z = (float(value) for value in turned / np.linalg.norm(turned))
    return Pose((float(position[0]), float(position[1]), float(position[2])), (w, x, y, z))


def _profile(length: float, speed: float, acceleration: float, jerk: float, sample_s: float) -> tuple[Array, Array]:
    """Times (n,) and the way gone (n,) from 0 to `length`, at rest at both ends."""
    request = ruckig.InputParameter(1)
    request.current_position, request.target_position = [0.0], [length]
    request.max_velocity, request.max_acceleration, request.max_jerk = [speed], [acceleration], [jerk]
    found = ruckig.Trajectory(1)
    result = ruckig.Ruckig(1).calculate(request, found)
    if result not in (ruckig.Result.Working, ruckig.Result.Finished):
        raise ValueError(f"ruckig refused a way of {length} at {speed}, {acceleration}, {jerk}: {result}")
    times: Array = np.arange(int(np.ceil(found.duration / sample_s)) + 1, dtype=np.float64) * sample_s
    way: Array = np.array([found.at_time(min(time, found.duration))[0][0] for time in times])
    way[-1] = length
    return times, way
