"""MoveTo: bring the arm to joints that the bench names, for example `park` or `look`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from cell.interfaces.observation import Observation
from cell.interfaces.perception import PartDetection
from skills.grip import STROKE_M
from skills.handling import bracket_boxes, seen_in_holes, tray_boxes
from skills.phases import Move, Phase, PhasedSkill
from skills.planner import Load, MotionPlanner

NamedPose = Literal["park", "look"]


class MoveTo(PhasedSkill):
    """Move to a named pose by a free way."""

    def __init__(self, planner: MotionPlanner, pose: NamedPose, tray_parts: Sequence[PartDetection] = ()) -> None:
        """Args:
        tray_parts: parts seen in the tray; the arm keeps clear of them.
        """
        super().__init__()
        self._planner, self._pose, self._tray_parts = planner, pose, tuple(tray_parts)

    def prepare(self, observation: Observation) -> Sequence[Phase] | str:
        """One motion."""
        planner = self._planner
        bench = planner.bench
        goal = np.array({"park": bench.arm_park_rad, "look": bench.arm_look_rad}[self._pose])
        obstacles = (*bracket_boxes(planner, seen_in_holes(observation)), *tray_boxes(planner, self._tray_parts))
        load = Load(min(STROKE_M, max(0.0, observation.gripper.opening_m)), obstacles)
        return [
            Move(
                f"moving to {self._pose}",
                lambda start: planner.free_move(start, goal, load),
                planner.settings,
            )
        ]

    @property
    def done(self) -> str:
        """What the skill has achieved, in words."""
        return f"arm at {self._pose}"
