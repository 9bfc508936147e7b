"""Feeling: a tool that hangs above where its trajectory has it by now has met something (guarded moves)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from cell.files.words.message import Message
from cell.interfaces.command import Command, GripperCommand
from cell.interfaces.observation import ObjectStatus, Observation
from cell.interfaces.pose import Array, Pose
from cell.interfaces.skill import Progress, SkillStatus
from skills.grasping.phases import FingersRest, Move, done, failed, held
from skills.grasping.way_down import WayDown
from skills.motion.grip import STROKE_M
from skills.motion.planner import Load, MotionPlanner, Plan

DOWN = np.array([0.0, 0.0, -1.0])
FELT = 0.3  # share of a line down that may be one motion with the way there: nothing is felt in it
LATE_S = 0.3  # before the line, fingers that still open stop the arm: then it stands above
BLENDED_LAG_M, BLENDED_S = 0.008, 0.3  # as `contact_lag_m`, and how long, where the way goes over into the line
RESTS_M = 0.005  # contact this near to the goal is the body on the plate, not the peg on the rim


def tool_height_m(planner: MotionPlanner, observation: Observation) -> float:
    """Height of the TCP as measured."""
    return planner.kinematics.forward(np.array(observation.arm.positions_rad)).position_m[2]


def can_feel(move: Move, observation: Observation) -> bool:
    """Whether a tool that hangs back has met something.

    One that is held may have been pushed off its path, and one that has lost its path hangs back from nothing.
    """
    follows = observation.arm.path_s is not None or observation.arm.moving
    return move.trajectory is not None and follows and not held(observation)


def meets_something(
    planner: MotionPlanner, move: Move, observation: Observation, along: Array = DOWN, lag_m: float | None = None
) -> bool:
    """Whether something holds the tool back by `lag_m` in the direction `along` (3,), by default on a straight way."""
    if move.trajectory is None or not can_feel(move, observation):
        return False
    settings = planner.settings
    followed_s = move.followed_s(observation) - settings.servo_lag_s
    expected = planner.kinematics.forward(move.trajectory.at(followed_s)).position_m
    measured = planner.kinematics.forward(np.array(observation.arm.positions_rad)).position_m
    return float(np.subtract(expected, measured) @ along) > (settings.contact_lag_m if lag_m is None else lag_m)


class Lower(WayDown):
    """Over a hole and down to it with the held part; ends in failure as soon as the part meets something."""

    def __init__(
        self, name: str, planner: MotionPlanner, above_rad: Array, load: Load, line: Callable[[], Plan]
    ) -> None:
        """Args:
        name: type of the held part.
        above_rad, load, line: as in `WayDown`.
        """
        self._name, self._planner = name, planner
        doing = Message("carrying {name}", name=name), Message("lowering {name}", name=name)
        super().__init__(doing, planner, above_rad, load, line, holding=name)

    def poll(self, observation: Observation, command: Command) -> Progress:
        """Follow the way and feel."""
        progress = super().poll(observation, command)
        if progress.status is SkillStatus.SUCCESS or not observation.gripper.holding:
            return progress
        if not self.only_line(observation, BLENDED_S):
            return progress
        lag_m = None if self.only_line(observation) else BLENDED_LAG_M
        stuck = progress.status is SkillStatus.FAILURE and can_feel(self, observation)
        if stuck or meets_something(self._planner, self, observation, lag_m=lag_m):
            return failed(Message("lowering {name}: it met something above its hole", name=self._name))
        return progress


class Descend:
    """A phase: over a part and straight down to it, which ends in failure as soon as the fingers meet something.

    The fingers open on the way; where they are late, the arm stops above. Around a part that was let go in its hole
    they do not close: they get their opening once the tool has left it.
    """

    def __init__(
        self,
        name: str,
        planner: MotionPlanner,
        above_rad: Array,
        target: Pose,
        loads: tuple[Load, Load],
        speed_m_s: float | None = None,
        *,
        feels: bool = False,
    ) -> None:
        """Args:
        name: type of the part.
        above_rad: joints (6,) over the part.
        target: world_from_tool when the fingers close.
        loads: over the part, and down to it with the fingers open as far.
        feels: what the fingers meet may be what the part lies on: they close there.
        """
        self._name, self._planner, self._feels = name, planner, feels
        self._above_rad, self._target, self._loads, self._speed_m_s = above_rad, target, loads, speed_m_s
        settings = planner.settings
        self._opening = GripperCommand(loads[1].opening_m, settings.gripper_speed_m_s, settings.grip_force_n)
        self._told = False
        self._rest: FingersRest | None = None
        self._move: WayDown | None = None

    def poll(self, observation: Observation, command: Command) -> Progress:
        """Open the fingers, follow the way and feel."""
        self._open(observation, command)
        if self._rest is not None:
            rests = self._rest.poll(observation, command)
            if rests.status is not SkillStatus.SUCCESS:
                return rests
            self._rest = None
        if self._move is None:
            self._move = self._way(observation)
        progress, move = self._move.poll(observation, command), self._move
        opens = not self._told or observation.gripper.object_status is ObjectStatus.MOVING
        if progress.status is SkillStatus.RUNNING and opens and move.only_line(observation, LATE_S):
            command.follow, command.stop_arm = None, True
            self._rest, self._move = FingersRest("opening the fingers", self._planner.settings), None
            return Progress(SkillStatus.RUNNING, "opening the fingers")
        felt = move.only_line(observation) and meets_something(self._planner, move, observation)
        if progress.status is SkillStatus.RUNNING and felt:
            if self._feels:
                command.follow, command.stop_arm = None, True
                return done(Message("the fingers feel what {name} lies on", name=self._name))
            return failed(Message("the fingers met something on the way down to {name}", name=self._name))
        return progress

    def _open(self, observation: Observation, command: Command) -> None:
        if self._told or held(observation):
            return
        self._planner.forget_left(np.array(observation.arm.positions_rad))
        if self._planner.around is None or self._opening.opening_m >= observation.gripper.opening_m:
            command.gripper, self._told = self._opening, True

    def _way(self, observation: Observation) -> WayDown:
        """With the fingers as wide as they still stand around a part."""
        over, down = self._loads
        if not self._told:
            over = replace(over, opening_m=min(STROKE_M, max(over.opening_m, observation.gripper.opening_m)))
        return WayDown(
            (Message("moving above {name}", name=self._name), Message("going down to {name}", name=self._name)),
            self._planner,
            self._above_rad,
            over,
            lambda: self._planner.straight_move(self._above_rad, self._target, down, self._speed_m_s),
            most=FELT,
        )


class SetDown:
    """A phase: straight down with the held part until it is there, or until it rests on something near there.

    A part that somebody has pulled down or tilted in the fingers meets the ground too early for the tool.
    """

    def __init__(
        self,
        name: str,
        planner: MotionPlanner,
        goal: Pose,
        load: Load,
        slipped_m: float,
        speed_m_s: float | None = None,
    ) -> None:
        """Args:
        name: type of the held part.
        goal: world_from_tool when it is let go.
        slipped_m: contact this far above the goal may still be the ground; higher up it is something else.
        speed_m_s: of the way down; the settings' by default.
        """
        self._name, self._planner, self._goal, self._slipped_m = name, planner, goal, slipped_m
        self._move = Move(
            Message("lowering {name}", name=name),
            lambda start: planner.straight_move(start, goal, load, speed_m_s),
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
            return failed(
                Message(
                    "lowering {name}: it met something {above_m} mm above where it should rest",
                    name=self._name,
                    above_m=f"{above_m * 1000:.0f}",
                )
            )
        command.follow, command.stop_arm = None, True
        return done(
            Message("{name} rests {above_m} mm higher than expected", name=self._name, above_m=f"{above_m * 1000:.0f}")
        )


class Insert:
    """A phase: slow descents, each ended by the goal or by contact, until one goes all the way.

    The error of a grasp lies along the tool's y: along its x the fingers have centred the part between them.
    """

    def __init__(self, name: str, planner: MotionPlanner, goal: Pose, depth_m: float, load: Load) -> None:
        """Args:
        name: type of the held part.
        goal: world_from_tool when it is let go.
        depth_m: the descents start this far above the goal.
        """
        self._name, self._planner, self._goal, self._depth_m, self._load = name, planner, goal, depth_m, load
        self._shifts_m = [0.0, *planner.settings.search_shifts_m]
        self._descending = True
        self._move = self._descent()

    def poll(self, observation: Observation, command: Command) -> Progress:
        """Lower, feel, and go back up where there was contact."""
        progress = self._move.poll(observation, command)
        if not self._descending:
            if progress.status is SkillStatus.SUCCESS:
                self._descending, self._move = True, self._descent()
                return self._move.poll(observation, command)
            return progress
        if progress.status is SkillStatus.FAILURE or not meets_something(self._planner, self._move, observation):
            return progress
        command.follow, command.stop_arm = None, True
        if tool_height_m(self._planner, observation) - self._goal.position_m[2] < RESTS_M:
            return done(Message("{name} rests on the bracket", name=self._name))
        self._shifts_m.pop(0)
        if not self._shifts_m:
            return failed(Message("the peg of {name} does not find its hole", name=self._name))
        self._descending, self._move = False, self._way_back()
        return Progress(SkillStatus.RUNNING, Message("{name} met the rim", name=self._name))

    def _descent(self) -> Move:
        return self._line(Message("lowering {name}", name=self._name), 0.0, self._planner.settings.insertion_speed_m_s)

    def _way_back(self) -> Move:
        return self._line(
            Message("trying {name} {shifts_m} mm beside", name=self._name, shifts_m=f"{self._shifts_m[0] * 1000:+.1f}"),
            self._depth_m,
            None,
        )

    def _line(self, doing: str, rise_m: float, speed_m_s: float | None) -> Move:
        shifted = self._goal @ Pose((0.0, self._shifts_m[0], -rise_m))
        planner, load = self._planner, self._load
        return Move(
            doing,
            lambda start: planner.straight_move(start, shifted, load, speed_m_s),
            planner.settings,
            holding=self._name,
        )
