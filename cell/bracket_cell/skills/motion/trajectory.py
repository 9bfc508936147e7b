"""Joint trajectories within the datasheet's limits: straight in joint space, or straight for the tool (ruckig)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
import ruckig

from bracket_cell.skills.motion.kinematics import Kinematics
from bracket_cell.skills.motion.settings import MotionSettings
from bracket_ground.interfaces.command import JointTrajectory
from bracket_ground.interfaces.pose import Array, Pose

BLENDS = (0.75, 0.6, 0.45, 0.3, 0.15)  # shares of the shorter leg in which two legs are one motion
ROUNDING = 1e-6
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

    The speed along the line is lowered until every joint keeps its limit.
    """
    start = kinematics.forward(start_rad)
    length = float(np.linalg.norm(np.subtract(world_from_goal.position_m, start.position_m)))
    if length < 1e-5:
        goal = kinematics.follow(world_from_goal, start_rad)
        return None if goal is None else joint_move(start_rad, goal, settings)
    scale = 1.0
    for _ in range(_SLOWDOWN_TRIES):
        times, way = _profile(
            length,
            settings.line_speed_m_s * scale,
            settings.line_acceleration_m_s2 * scale**2,
            settings.line_jerk_m_s3 * scale**3,
            settings.sample_s,
        )
        positions = _follow_line(kinematics, start_rad, start, world_from_goal, way / length)
        if positions is None:
            return None
        excess = speed_excess(times, positions, settings)
        if excess <= 1.0:
            return JointTrajectory(times, positions)
        scale *= 0.95 / excess
    return None


def joint_speeds(times_s: Array, positions_rad: Array) -> Array:
    """Joint speeds (n - 1, 6) in [rad/s] between samples."""
    speeds: Array = np.diff(positions_rad, axis=0) / np.diff(times_s)[:, None]
    return speeds


def speed_excess(times_s: Array, positions_rad: Array, settings: MotionSettings) -> float:
    """Largest ratio of a joint's speed to its limit, or of its acceleration to its limit as a ratio of speeds."""
    speeds = joint_speeds(times_s, positions_rad)
    accelerations = np.diff(speeds, axis=0) / settings.sample_s
    fastest = np.abs(speeds / np.array(settings.speed_limits_rad_s)).max(initial=0.0)
    hardest = np.abs(accelerations / np.array(settings.acceleration_limits_rad_s2)).max(initial=0.0)
    return float(max(fastest, np.sqrt(hardest)))


def joined(legs: Sequence[JointTrajectory]) -> JointTrajectory:
    """One trajectory out of legs that each start where the last one ends."""
    times, positions, offset = [np.zeros(1)], [legs[0].positions_rad[:1]], 0.0
    for leg in legs:
        times.append(leg.times_s[1:] + offset)
        positions.append(leg.positions_rad[1:])
        offset += leg.duration_s
    return JointTrajectory(np.concatenate(times), np.concatenate(positions))


def blended(
    legs: Sequence[JointTrajectory], settings: MotionSettings, is_free: Callable[[Array], bool], most: float = 1.0
) -> JointTrajectory:
    """The same without stops: each leg begins, added to the one before, as early as limits and room allow.

    Args:
        legs: each starts where the last one ends, at rest.
        is_free: whether a path (k, n) touches nothing.
        most: share of the shorter leg in which two legs are one motion at most.
    """
    whole = legs[0]
    for before, leg in pairwise(legs):
        whole = joined([whole, leg])
        shortest = min(len(before.times_s), len(leg.times_s)) - 1
        for share in (share for share in BLENDS if share <= most):
            overlap = int(share * shortest)
            corner = len(whole.times_s) - len(leg.times_s)
            early = _added(whole.positions_rad, corner, overlap)
            near = early[max(0, corner - overlap - 3) : corner + 4]
            if overlap > 1 and _within(near, settings) and is_free(near):
                whole = JointTrajectory(settings.sample_s * np.arange(len(early), dtype=np.float64), early)
                break
    return whole


def _added(path_rad: Array, corner: int, overlap: int) -> Array:
    """A path (k, n) whose part behind a corner begins so many samples earlier, added to what is before it."""
    behind = path_rad[corner:] - path_rad[corner]
    early = np.concatenate(
        [path_rad[: corner + 1], np.repeat(path_rad[corner : corner + 1], len(behind) - overlap - 1, 0)]
    )
    early[corner - overlap :] += behind
    return early


def _within(path_rad: Array, settings: MotionSettings) -> bool:
    """Whether speeds and accelerations between samples are legal."""
    times_s: Array = settings.sample_s * np.arange(len(path_rad), dtype=np.float64)
    return speed_excess(times_s, path_rad, settings) <= 1.0 + ROUNDING


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
