"""Feeling: a tool that hangs above where its trajectory has it by now has met something."""

from __future__ import annotations

import numpy as np

from cell.interfaces.command import Command
from cell.interfaces.observation import Observation
from cell.interfaces.pose import Array, Pose
from cell.interfaces.skill import Progress, SkillStatus
from skills.phases import Move, failed
from skills.planner import Load, MotionPlanner


def tool_height_m(planner: MotionPlanner, observation: Observation) -> float:
    """Height of the TCP as measured."""
    return planner.kinematics.forward(np.array(observation.arm.positions_rad)).position_m[2]


DOWN = np.array([0.0, 0.0, -1.0])


def meets_something(planner: MotionPlanner, move: Move, observation: Observation, along: Array = DOWN) -> bool:
    """Whether something holds the tool back on a straight way in the direction `along` (3,)."""
    if move.trajectory is None:
        return False
    settings = planner.settings
    followed_s = move.followed_s(observation) - settings.servo_lag_s
    expected = planner.kinematics.forward(move.trajectory.at(followed_s)).position_m
    measured = planner.kinematics.forward(np.array(observation.arm.positions_rad)).position_m
    return float(np.subtract(expected, measured) @ along) > settings.contact_lag_m


class Descend:
    """A phase: straight down to a part, which ends in failure as soon as the fingers meet something."""

    def __init__(
        self, name: str, planner: MotionPlanner, target: Pose, load: Load, speed_m_s: float | None = None
    ) -> None:
        """Args:
        name: type of the part.
        target: world_from_tool when the fingers close.
        """
        self._name, self._planner = name, planner
        self._move = Move(
            f"going down to {name}",
            lambda start: planner.straight_move(start, target, load, speed_m_s),
            planner.settings,
        )

    def poll(self, observation: Observation, command: Command) -> Progress:
        """Follow the line and feel."""
        progress = self._move.poll(observation, command)
        if progress.status is SkillStatus.RUNNING and meets_something(self._planner, self._move, observation):
            return failed(f"the fingers met something on the way down to {self._name}")
        return progress
