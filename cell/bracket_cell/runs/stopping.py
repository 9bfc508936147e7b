"""Measures how each joint of an arm stops: it is driven, told to hold, and watched until it stands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bracket_cell.runs.slow_motion import MOVING_MODES, PATIENCE_S, SHARE, move_to
from bracket_cell.skills.motion.planner import Load, MotionPlanner
from bracket_cell.skills.motion.settings import Stopping
from bracket_cell.skills.motion.trajectory import joint_move
from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.command import JointTrajectory
from bracket_ground.interfaces.devices import Devices
from bracket_ground.interfaces.observation import STANDING_RAD_S
from bracket_ground.interfaces.pose import Array


@dataclass(frozen=True)
class StoppingLimits:
    """How a joint is driven and watched. Origin: chosen, as small as a joint still becomes fast on it.

    Attributes:
        ways_rad: [rad] that are tried, either way, until one is free.
        at: share of the way's time after which the arm is told to hold: it is at its fastest about then.
        near_peak: share of the fastest speed that counts as not braking yet.
        brakes: shares of the speed at the order between which the braking is a mean.
        period_s: [s] between reads, as often as the arm is told to go on.
    """

    ways_rad: tuple[float, ...] = (0.5, -0.5, 0.3, -0.3)
    at: float = 0.4
    near_peak: float = 0.98
    brakes: tuple[float, float] = (0.9, 0.1)
    period_s: float = 0.008


LIMITS = StoppingLimits()
DIGITS = 4
FAST_RAD_S = 10 * STANDING_RAD_S  # of a joint whose braking can be told
Stop = tuple[float, float, float, float]  # [s] until it brakes, [s] until it stands, [rad] until then, [rad/s2]


def measured(devices: Devices, motion: MotionPlanner, tell: Callable[[str], None]) -> Stopping:
    """Drive every joint about the pose in which the arm stands, which it takes again after each.

    Raises:
        DeviceFault: the arm gave up, did not stop, or a joint has no free way here.
    """
    home, share = np.array(devices.arm.state().positions_rad), motion.settings.speed_share
    found = []
    for number, (name, unit) in enumerate(zip(motion.settings.robot.joints, motion.settings.robot.units, strict=True)):
        stop = _stop(devices, _way(motion, home, number), number, share)
        tell(
            f"{name}: reacts in {1e3 * stop[0]:.0f} ms, stands after {1e3 * stop[1]:.0f} ms and {stop[2]:.3f} {unit}, "
            f"brakes with {stop[3]:.1f} {unit}/s2"
        )
        found.append([round(value, DIGITS) for value in stop])
        move_to(devices, motion, home, min(share, SHARE))
    reacts, stops, over, brakes = zip(*found, strict=True)
    return Stopping(reacts_s=reacts, stops_s=stops, over_rad=over, brakes_rad_s2=brakes)


def _way(motion: MotionPlanner, home_rad: Array, number: int) -> JointTrajectory:
    """A free way of one joint alone."""
    scene = motion.scene(Load(motion.open_m))
    for way_rad in LIMITS.ways_rad:
        goal = home_rad.copy()
        goal[number] += way_rad
        if motion.kinematics.within_limits(goal) and scene.is_free(np.array([home_rad, goal])):
            return joint_move(home_rad, goal, motion.settings)
    name = motion.settings.robot.joints[number]
    raise DeviceFault("arm", f"{name} cannot turn by {min(map(abs, LIMITS.ways_rad))} rad here: move the arm to park")


def _stop(devices: Devices, way: JointTrajectory, number: int, share: float) -> Stop:
    """How a joint stops after the order to hold."""
    arm, clock = devices.arm, devices.clock
    arm.samples()
    arm.follow(way)
    ordered_s = clock.now_s() + LIMITS.at * way.duration_s / share
    times, places, speeds, stood = [], [], [], False
    try:
        while not stood:
            arm.pace(share * (clock.now_s() < ordered_s))
            clock.sleep_until(clock.now_s() + LIMITS.period_s)
            state = arm.state()
            if state.mode not in MOVING_MODES:
                raise DeviceFault("arm", state.reason or f"it went into the mode {state.mode}")
            times.append(state.time_s)
            places.append(state.positions_rad[number])
            speeds.append(abs(state.velocities_rad_s[number]))
            if clock.now_s() > ordered_s + PATIENCE_S:
                raise DeviceFault("arm", f"it did not stand within {PATIENCE_S:g} s of the order to hold")
            stood = state.time_s > ordered_s + LIMITS.period_s and speeds[-1] < STANDING_RAD_S
    finally:
        arm.stop()
    return _read(np.array(times), np.array(places), np.array(speeds), ordered_s)


def _read(times_s: Array, places_rad: Array, speeds_rad_s: Array, ordered_s: float) -> Stop:
    peak_rad_s, after = float(speeds_rad_s.max()), times_s > ordered_s
    if not peak_rad_s > FAST_RAD_S:
        raise DeviceFault("arm", f"a joint did not become faster than {FAST_RAD_S} rad/s: nothing can be measured")
    fast = np.flatnonzero(speeds_rad_s >= LIMITS.near_peak * peak_rad_s)[-1]
    high, low = (share * peak_rad_s for share in LIMITS.brakes)
    first_s = times_s[np.flatnonzero(speeds_rad_s >= high)[-1]]
    last_s = times_s[after & (times_s > first_s) & (speeds_rad_s <= low)][0]
    over_rad = abs(float(places_rad[-1] - np.interp(ordered_s, times_s, places_rad)))
    brakes = (high - low) / float(last_s - first_s)
    return max(0.0, float(times_s[fast]) - ordered_s), float(times_s[-1]) - ordered_s, over_rad, brakes
