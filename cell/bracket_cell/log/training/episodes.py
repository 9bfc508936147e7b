"""Rows of episodes from a log: what the arm measured and what was asked of it, at the overhead camera's rate."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from bracket_cell.log.read.frames import Frames
from bracket_cell.log.read.joints import joint_names
from bracket_cell.log.read.reader import Log, json_of
from bracket_ground.errors import LogError
from bracket_ground.interfaces.pose import Array

RATE_HZ = 15.0  # of a data set without images
LATE_IMAGES = 2.5  # periods of a camera: older, the image of a row was left out of the log


@dataclass(eq=False)
class Episode:
    """The rows of one log, or of a stretch of it between ticks that are missing.

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


def episodes_of(log: Log, rate_hz: float) -> list[Episode]:
    """Rows at a constant rate from the first overhead image to the last tick; where some are missing, rows are, too.

    What follows is another episode. It begins where the arm stands: what a moving one was asked, the gap may have held.

    Raises:
        LogError: there is no row.
    """
    ticks, images_s = log.ticks, image_times_s(log)
    starts, numbers = np.array([(tick.time_s, tick.number) for tick in ticks]).T
    first_s = max([float(starts[0]), *images_s[:1]])
    count = int((starts[-1] - first_s) * rate_hz) + 1
    times_s = first_s + np.arange(count) / rate_hz
    at = _newest(starts, times_s)
    later = _newest(starts, times_s + 1 / rate_hz)
    measured = np.array([[*tick.observation.arm.positions_rad, tick.observation.gripper.opening_m] for tick in ticks])
    asked, known = _asked(log, measured)
    last = np.maximum(later, np.minimum(at + 1, len(ticks) - 1))
    whole = known[at] & (numbers[last] - numbers[at] == last - at)
    if len(images_s) > 1:
        ages_s = times_s - np.array(images_s)[_newest(np.array(images_s), times_s)]
        whole &= ages_s < LATE_IMAGES * np.median(np.diff(images_s))
    kept = np.flatnonzero(whole)
    if not len(kept):
        raise LogError(log.path, "has too many gaps: of no tick it is known what the arm was asked")
    goal = json_of(log.path, log.result, "goal", str) or log.metadata.get("goal", "")
    task = f"Help a person to assemble {log.metadata.get('product', 'a product')} {goal}".strip()
    success, joints, after = json_of(log.path, log.result, "correct", bool), joint_names(log), _after(log)
    ended = bool(log.outcome) and log.ticks_of_run == numbers[-1] + 1
    return [
        Episode(*(times_s[rows], measured[at[rows]], asked[later[rows]], after[at[rows]], task),
                success and done, ended and done, joints)
        for rows in np.split(kept, np.flatnonzero(np.diff(kept) > 1) + 1)
        for done in [bool(rows[-1] == count - 1)]
    ]  # fmt: skip


def _newest(of_s: Array, times_s: Array) -> Any:
    """The place of the newest of these times at each of those, of the first before it."""
    return np.clip(np.searchsorted(of_s, times_s + 1e-9, side="right") - 1, 0, None)


def _after(log: Log) -> Array:
    """Where the part stood that the newest plan names, at each tick: (ticks, 3)."""
    found, now = [], (0.0, 0.0, 0.0)
    for place, tick in enumerate(log.ticks):
        now = (0.0, 0.0, 0.0) if log.begins_at(place) else now
        for topic, fields in tick.notes:
            seen = tick.observation.parts
            if topic == "plan" and seen is not None and 0 <= fields.get("required", -1) < len(seen.detections):
                now = seen.detections[fields["required"]].world_from_part.position_m
        found.append(now)
    return np.array(found)


def _asked(log: Log, measured: Array) -> tuple[Array, Any]:
    """Joints and opening that were asked for at each tick: (ticks, n + 1); and whether that is known of it.

    What nobody asked anything is asked to be as it is: a gripper closes itself as it is activated.
    How far along its trajectory the arm is, it tells, or it follows at the share of speed that was allowed.
    """
    asked, knows = measured.copy(), []
    trajectory: tuple[Array, Array] | None = None
    for place, tick in enumerate(log.ticks):
        if log.begins_at(place):
            trajectory, joints, opening, path_s, known = None, None, None, 0.0, not tick.number
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
        asked[place, :-1] = measured[place, :-1] if joints is None else joints
        asked[place, -1] = measured[place, -1] if opening is None else opening
        known = known or bool(follow or command.get("stop_arm")) or not tick.observation.arm.moving
        knows.append(known)
    return asked, np.array(knows)


def image_times_s(log: Log) -> list[float]:
    """When the overhead camera took those images that are in the log."""
    return Frames(log).times_s("overhead")


def rate_hz_of(log: Log, *, filmed: bool) -> float:
    """Rows a second: the camera's, or RATE_HZ of logs without images.

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
    return Frames(log).rate_hz("overhead")
