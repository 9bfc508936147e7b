"""Where the robot was when a frame was taken: so detectors do not take it for something else."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from cell.interfaces.observation import ArmState, GripperState
from cell.interfaces.pose import Array
from skills.arm_outline import ArmOutline
from skills.collision import HELD

KEPT = 12  # states of the arm: half a second
NEAR_S = 0.1  # a state that is farther in time from a frame tells nothing of it


class OwnBody:
    """Remembers the arm's last states."""

    def __init__(self, outline: ArmOutline) -> None:
        self._outline = outline
        self._part = np.array([name == HELD for name in outline.names])
        self._states: deque[tuple[float, tuple[float, ...], bool]] = deque(maxlen=KEPT)

    def keep(self, arm: ArmState, gripper: GripperState) -> None:
        """One more state as measured."""
        known = len(arm.positions_rad) == 6 and all(map(math.isfinite, arm.positions_rad))
        if known and (not self._states or arm.time_s > self._states[-1][0]):
            self._states.append((arm.time_s, arm.positions_rad, gripper.holding))

    def at(self, time_s: float) -> Array | None:
        """Points around the links at a time, see `Frame.robot_m`; None where the arm was not measured about then.

        The points are those of the last state before and of the first one after, so their hull holds what is between.
        """
        before = [one for one in self._states if one[0] <= time_s][-1:]
        after = [one for one in self._states if one[0] > time_s][:1]
        near = [one for one in (*before, *after) if abs(one[0] - time_s) <= NEAR_S]
        if not near:
            return None
        placed = self._outline.placed(np.array([joints for _, joints, _ in near]))
        points: Array = np.concatenate(list(self._outline.corners_m(placed)), axis=1)
        held = any(holding for _, _, holding in near)
        return points if held else points[~self._part]
