"""How late a camera's stamps are, measured by a swing of the arm: the image changes when the joints move."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from bracket_cell.runs.slow_motion import MOVING_MODES, PATIENCE_S, PERIOD_S, STILL_S
from bracket_cell.skills.motion.planner import Load, MotionPlanner
from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.devices import Camera, Devices
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.pose import Array

SWING_RAD = 0.25  # of the base
SWINGS = 4  # there and back
SHARE = 0.6
TILE = 4  # pixels of the image in one that is compared
LEAST_S, MOST_S, STEP_S = -0.2, 1.0, 0.002  # delays that are tried
LEAST_FIT = 0.7  # correlation of what is seen and what the joints did
SMOOTH_S = 0.02
LEVELS = 10.0  # a pixel that differs by more has changed


def measured_delays_s(devices: Devices, motion: MotionPlanner) -> dict[str, float]:
    """Delay of each camera that sees the arm swing, beside the one that its driver takes off already.

    Raises:
        DeviceFault: the arm cannot swing from where it stands, or a camera sends nothing.
    """
    start = np.array(devices.arm.state().positions_rad)
    goal = start + np.array([_free_swing(start, motion), 0, 0, 0, 0, 0])
    cameras = {"overhead": devices.overhead, "wrist": devices.wrist}
    watchers = {name: _Watcher(camera) for name, camera in cameras.items()}
    times_s, speeds = [], list[float]()
    for swing in range(SWINGS):
        for time_s, speed in _swung(devices, motion, start if swing % 2 else goal, list(watchers.values())):
            times_s.append(time_s)
            speeds.append(speed)
    found = {}
    for name, watcher in watchers.items():
        if len(watcher.times_s) < 2:
            raise DeviceFault(f"camera {name}", "no frames came while the arm moved")
        if (delay_s := delay_of(watcher.times_s, watcher.changes, times_s, speeds)) is not None:
            found[name] = delay_s
    return found


def delay_of(
    stamps_s: Sequence[float], changes: Sequence[float], times_s: Sequence[float], speeds: Sequence[float]
) -> float | None:
    """By how much stamps are later than what they show; None where the images do not show the motion.

    Args:
        stamps_s: of images.
        changes: of each against the one before it.
        times_s, speeds: of the arm, as often as it was measured.
    """
    stamps = (np.array(stamps_s)[1:] + np.array(stamps_s)[:-1]) / 2
    seen = np.array(changes)[1:]
    order = np.argsort(times_s, kind="stable")
    clock, moved = np.array(times_s)[order], np.minimum(np.array(speeds)[order], np.percentile(speeds, 90))
    span = np.concatenate([[0.0], np.cumsum(np.diff(clock) * (moved[1:] + moved[:-1]) / 2)])
    half = np.diff(np.array(stamps_s)) / 2 + SMOOTH_S
    delays = np.arange(LEAST_S, MOST_S, STEP_S)
    fits = []
    for delay_s in delays:
        way = np.interp(stamps - delay_s + half, clock, span) - np.interp(stamps - delay_s - half, clock, span)
        flat = float(np.std(way)) < 1e-9 or float(np.std(seen)) < 1e-9
        fits.append(0.0 if flat else float(np.corrcoef(way, seen)[0, 1]))
    best = int(np.argmax(fits))
    return float(delays[best]) if fits[best] >= LEAST_FIT and 0 < best < len(delays) - 1 else None


class _Watcher:
    """Takes what a camera sees, and how much of it changes."""

    def __init__(self, camera: Camera) -> None:
        self._camera, self._frame = camera, camera.latest()
        self._small: Array | None = None
        self._asked_s = float("-inf")
        self.times_s: list[float] = []
        self.changes: list[float] = []

    def look(self, now_s: float) -> None:
        """Take the newest frame, if it is a new one."""
        if now_s >= self._asked_s + PERIOD_S:
            self._asked_s = now_s
            self._camera.trigger()
        frame = self._camera.latest()
        if frame is None or frame is self._frame:
            return
        self._frame, small = frame, _small(frame)
        self.changes.append(0.0 if self._small is None else _changed(small - self._small))
        self.times_s.append(frame.time_s)
        self._small = small


def _changed(difference: Array) -> float:
    """Share of an image that is another, whatever the light does."""
    return float((np.abs(difference - np.median(difference)) > LEVELS).mean())


def _small(frame: Frame) -> Array:
    grey = cv2.cvtColor(frame.image, cv2.COLOR_RGB2GRAY)
    return np.asarray(cv2.resize(grey, None, fx=1 / TILE, fy=1 / TILE, interpolation=cv2.INTER_AREA), float)


def _free_swing(start: Array, motion: MotionPlanner) -> float:
    """An angle by which the base can turn from here; raises DeviceFault where it cannot."""
    for angle in (SWING_RAD, -SWING_RAD, SWING_RAD / 2, -SWING_RAD / 2):
        way = motion.free_move(start, start + angle * np.eye(len(start))[0], Load(motion.open_m))
        if not isinstance(way, str):
            return angle
    raise DeviceFault("arm", "the base cannot swing from where the arm stands: move it to the pose look first")


def _swung(
    devices: Devices, motion: MotionPlanner, goal: Array, watchers: Sequence[_Watcher]
) -> list[tuple[float, float]]:
    """Swing, look meanwhile; times and speeds of the base."""
    arm, clock = devices.arm, devices.clock
    way = motion.free_move(np.array(arm.state().positions_rad), goal, Load(motion.open_m))
    if isinstance(way, str):
        raise DeviceFault("arm", f"cannot swing: {way}")
    arm.samples()
    arm.follow(way)
    measured: list[tuple[float, float]] = []
    until_s, still_s = clock.now_s() + way.duration_s / SHARE + PATIENCE_S, 0.0
    while still_s < STILL_S:
        arm.pace(SHARE)
        clock.sleep_until(clock.now_s() + PERIOD_S / 4)
        for watcher in watchers:
            watcher.look(clock.now_s())
        state, samples = arm.state(), arm.samples()
        if state.mode not in MOVING_MODES:
            raise DeviceFault("arm", state.reason or f"it went into the mode {state.mode}")
        if samples is None:
            measured.append((state.time_s, abs(state.velocities_rad_s[0])))
        else:
            measured += zip(samples.times_s.tolist(), np.abs(samples.velocities_rad_s[:, 0]).tolist(), strict=True)
        still_s = 0.0 if state.moving else still_s + PERIOD_S / 4
        if clock.now_s() > until_s:
            arm.stop()
            raise DeviceFault("arm", "it did not come to the end of its swing")
    return measured
