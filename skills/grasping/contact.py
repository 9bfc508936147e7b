"""Feeling: a tool that hangs above where its trajectory has it by now has met something (guarded moves)."""

from __future__ import annotations

import numpy as np

from cell.interfaces.command import Command
from cell.interfaces.observation import Observation
from cell.interfaces.pose import Array, Pose
from cell.interfaces.skill import Progress, SkillStatus
from skills.grasping.phases import Move, done, failed, held
from skills.motion.planner import Load, MotionPlanner


def tool_height_m(planner: MotionPlanner, observation: Observation) -> float:
    """Height of the TCP as measured."""
    return planner.kinematics.forward(np.array(observation.arm.positions_rad)).position_m[2]


DOWN = np.array([0.0, 0.0, -1.0])


def can_feel(move: Move, observation: Observation) -> bool:
    """Whether a tool that hangs back has met something.

    One that is held may have been pushed off its path, and one that has lost its path hangs back from nothing.
    """
    follows = observation.arm.path_s is not None or observation.arm.moving
    return move.trajectory is not None and follows and not held(observation)


def meets_something(planner: MotionPlanner, move: Move, observation: Observation, along: Array = DOWN) -> bool:
    """Whether something holds the tool back on a straight way in the direction `along` (3,)."""
    if move.trajectory is None or not can_feel(move, observation):
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


class SetDown:
    """A phase: straight down with the held part until it is there, or until it rests on something near there.

    A part that somebody has pulled down or tilted in the fingers meets the ground too early for the tool.
    """

    def __init__(self, name: str, planner: MotionPlanner, goal: Pose, load: Load, slipped_m: float) -> None:
        """Args:
        name: type of the held part.
        goal: world_from_tool when it is let go.
        slipped_m: contact this far above the goal may still be the ground; higher up it is something else.
        """
        self._name, self._planner, self._goal, self._slipped_m = name, planner, goal, slipped_m
        self._move = Move(
            f"lowering {name}",
            lambda start: planner.straight_move(start, goal, load),
            planner.settings,
            holding=name,
        )

    def poll(self, observation: Observation, command: Command) -> Progress:
        """Lower and feel."""
        progress = self._move.poll(observation, command)
        if progress.status is SkillStatus.SUCCESS or not observation.gripper.holding:
            return progress
        stuck = progress.status is SkillStatus.FAILURE and can_feel(self._move, observation)
        if not stuck and not meets_something(self._planner, self._move, observation):
            return progress
        above_m = tool_height_m(self._planner, observation) - self._goal.position_m[2]
        if above_m > self._slipped_m:
            return failed(f"lowering {self._name}: it met something {above_m * 1000:.0f} mm above where it should rest")
        command.follow, command.stop_arm = None, True
        return done(f"{self._name} rests {above_m * 1000:.0f} mm higher than expected")
