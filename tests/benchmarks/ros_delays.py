"""How late topics of ROS 2 come through a run: a listener beside it, and what a command is late by until the arm moves.

All times are the wall's, as DDS stamps a sample when it is written; a reader has it once it is decoded.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager

import numpy as np

from bracket_cell.plant.dds import SENSOR, Node, Quality, waited
from bracket_cell.plant.ros_arm import ACTION, JOINTS
from bracket_cell.plant.ros_types import message
from bracket_cell.skills.drivers.settings import Ros2ArmSettings
from bracket_ground.interfaces.pose import Array

LISTENS_S, CLOSES_S = 0.2, 5.0
STILL_RAD_S, MOVES_RAD_S, LONGEST_S = 0.005, 0.01, 3.0  # what a command may be late by, in the wall's time
ROLES = ("overhead", "wrist")
GOALS = Quality(kept=100)

Delays = Mapping[str, Sequence[float]]


class Listener:
    """Hears joints, images and goals, a thread each; nothing is written."""

    def __init__(self, domain: int) -> None:
        arm = Ros2ArmSettings(domain=domain)
        node, action = Node(arm), f"{arm.controller}/follow_joint_trajectory/_action/send_goal"
        asked = message(f"{ACTION}_SendGoal_Request", numbered=True)
        self._late_s: dict[str, list[float]] = {"joints": [], **{role: [] for role in ROLES}}
        self._goals_s: list[float] = []
        self._speeds: list[tuple[float, float]] = []  # when written, and the fastest joint's
        self._closed = threading.Event()
        image = "sensor_msgs/msg/CompressedImage"
        self._readers = {
            "joints": node.subscription("/joint_states", JOINTS, SENSOR),
            "goals": node.reader(f"rq/{action}Request", asked, GOALS),
            **{role: node.subscription(f"/{role}/color/image_raw/compressed", image, SENSOR) for role in ROLES},
        }
        self._threads = [threading.Thread(target=self._hear, args=(name,), daemon=True) for name in self._readers]
        for thread in self._threads:
            thread.start()

    def close(self) -> Delays:
        """Delays in [s] of joints, of each camera's images, and of commands until the arm moves."""
        self._closed.set()
        for thread in self._threads:
            thread.join(CLOSES_S)
        return self._late_s | {"motion": commands_to_motion(self._goals_s, np.array(self._speeds))}

    def _hear(self, name: str) -> None:
        while not self._closed.is_set():
            if (came := waited(self._readers[name], LISTENS_S)) is None:
                continue
            written_s = came.sample_info.source_timestamp * 1e-9
            if name == "goals":
                self._goals_s.append(written_s)
                continue
            if name != "joints":
                self._late_s[name].append(time.time() - written_s)
            elif len(came.velocity) > 1:  # the gripper tells its one joint on the same topic
                self._late_s[name].append(time.time() - written_s)
                self._speeds.append((written_s, float(np.abs(came.velocity).max())))


@contextmanager
def listened(domain: int | None) -> Iterator[dict[str, Sequence[float]]]:
    """Delays in [s] by what was heard, filled at the end; empty without a domain."""
    told: dict[str, Sequence[float]] = {}
    listener = None if domain is None else Listener(domain)
    try:
        yield told
    finally:
        told |= {} if listener is None else listener.close()


def commands_to_motion(goals_s: Sequence[float], speeds: Array) -> list[float]:
    """From each goal that an arm at rest got to the first sample in which it moves, in [s].

    Args:
        goals_s: when they were written, ascending.
        speeds: shape (N, 2): when a sample was written, and the fastest joint's speed [rad/s].
    """
    found: list[float] = []
    begun_s = float("-inf")
    for goal_s in goals_s:
        before = np.searchsorted(speeds[:, 0], goal_s) if len(speeds) else 0
        if not before or goal_s < begun_s or speeds[before - 1, 1] > STILL_RAD_S:
            continue
        after = speeds[before:]
        moves = np.flatnonzero((after[:, 1] > MOVES_RAD_S) & (after[:, 0] < goal_s + LONGEST_S))
        if len(moves):
            begun_s = float(after[moves[0], 0])
            found.append(begun_s - goal_s)
    return found


def summary(delays: Delays) -> list[str]:
    """A line for each: median, 95 % and how many."""
    return [
        f"{name}: median {1e3 * np.median(late):.1f} ms, 95 % {1e3 * np.quantile(late, 0.95):.1f} ms (n {len(late)})"
        for name, late in delays.items()
        if len(late)
    ]
