"""Rows of an episode from a log: what the arm measured and what was asked of it, at the overhead camera's rate."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from bracket_cell.log.read.frames import Frames
from bracket_cell.log.read.joints import joint_names
from bracket_cell.log.read.reader import Log, json_of
from bracket_ground.errors import LogError
from bracket_ground.interfaces.pose import Array

RATE_HZ = 15.0  # of a data set without images


@dataclass(eq=False)
class Episode:
    """The rows of one log.

    Attributes:
        states, actions: (rows, n + 1) joints and opening, measured and asked for.
        times_s: of the log's clock.
        parts_m: (rows, 3) where the part stood that the robot was after; zeros before.
        task: in words.
        success: the bracket is right; None where nobody knows.
        ended: the log holds the run's end.
        joints: what the log calls them.
        pixels: some of each camera's, (n, 3) from 0 to 1.
    """

    times_s: Array
    states: Array
    actions: Array
    parts_m: Array
    task: str
    success: bool | None
    ended: bool = True
    joints: tuple[str, ...] = ()
    pixels: dict[str, list[Array]] = field(default_factory=dict)


def rows_of(log: Log, rate_hz: float) -> Episode:
    """Rows at a constant rate from the first overhead image to the last tick."""
    ticks = log.ticks
    starts = np.array([tick.time_s for tick in ticks])
    first_s = max([float(starts[0]), *image_times_s(log)[:1]])
    count = int((starts[-1] - first_s) * rate_hz) + 1
    times_s = first_s + np.arange(count) / rate_hz
    at = np.clip(np.searchsorted(starts, times_s + 1e-9, side="right") - 1, 0, len(ticks) - 1)
    measured = np.array([[*tick.observation.arm.positions_rad, tick.observation.gripper.opening_m] for tick in ticks])
    asked = _asked(log, measured)
    later = np.minimum(np.searchsorted(starts, times_s + 1 / rate_hz + 1e-9, side="right") - 1, len(ticks) - 1)
    goal = json_of(log.path, log.result, "goal", str) or log.metadata.get("goal", "")
    task = f"Help a person to assemble {log.metadata.get('product', 'a product')} {goal}".strip()
    rows = times_s, measured[at], asked[later], _after(log)[at]
    return Episode(*rows, task, json_of(log.path, log.result, "correct", bool), not log.unfinished, joint_names(log))


def _after(log: Log) -> Array:
    """Where the part stood that the newest plan names, at each tick: (ticks, 3)."""
    found, now = [], (0.0, 0.0, 0.0)
    for tick in log.ticks:
        for topic, fields in tick.notes:
            seen = tick.observation.parts
            if topic == "plan" and seen is not None and 0 <= fields.get("required", -1) < len(seen.detections):
                now = seen.detections[fields["required"]].world_from_part.position_m
        found.append(now)
    return np.array(found)


def _asked(log: Log, measured: Array) -> Array:
    """Joints and opening that were asked for at each tick: (ticks, n + 1).

    How far along its trajectory the arm is, it tells, or it follows at the share of speed that was allowed.
    """
    asked = measured.copy()
    joints, opening = measured[0, :-1], measured[0, -1]
    trajectory: tuple[Array, Array] | None = None
    path_s = 0.0
    for place, tick in enumerate(log.ticks):
        period_s = tick.time_s - log.ticks[place - 1].time_s if place else 0.0
        told_s = tick.observation.arm.path_s
        path_s = path_s + period_s * tick.observation.speed_scale if told_s is None else told_s
        command = tick.command or {}
        follow = command.get("sent_follow") or (command.get("follow") if command.get("sent_as_asked") else None)
        if follow:
            trajectory, path_s = (np.array(follow["times_s"]), np.array(follow["positions_rad"])), 0.0
        elif command.get("stop_arm"):
            trajectory, joints = None, measured[place, :-1]
        if gripper := command.get("sent_gripper"):
            opening = float(gripper["opening_m"])
        if trajectory is not None:
            times_s, points = trajectory
            joints = np.array([np.interp(path_s, times_s, column) for column in points.T])
        asked[place] = [*joints, opening]
    return asked


def image_times_s(log: Log) -> list[float]:
    """When the overhead camera took those images that are in the log."""
    return Frames(log).times_s("overhead")


def rate_hz_of(log: Log, *, filmed: bool) -> float:
    """Rows a second: the camera's; images that the recorder left out, as the disk did not keep up, do not change it.

    Of logs without images it is RATE_HZ.

    Raises:
        LogError: there are too few.
    """
    if not filmed and log.ticks:
        return RATE_HZ
    times_s = image_times_s(log)
    if len(times_s) < 2 or not log.ticks:
        raise LogError(
            log.path, f"holds {len(times_s)} overhead images and {len(log.ticks)} ticks; an episode needs both"
        )
    steps_s = np.diff(times_s)
    return 1 / float(np.mean(steps_s[steps_s < 1.5 * np.median(steps_s)]))
