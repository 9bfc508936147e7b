"""Feeling: a tool that hangs above where its trajectory has it by now has met something (guarded moves)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from bracket_cell.skills.grasping.phases import FingersRest, Move, done, failed, held
from bracket_cell.skills.grasping.way_down import WayDown
from bracket_cell.skills.motion.motions import Line, WayAndLine
from bracket_cell.skills.motion.planner import Load, MotionPlanner
from bracket_ground.files.words.message import Message
from bracket_ground.interfaces.command import Command, GripperCommand
from bracket_ground.interfaces.observation import ObjectStatus, Observation
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.skill import Progress, SkillStatus

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


@dataclass(eq=False)
class Lower(WayDown):
    """Over a hole and down to it with the held part; ends in failure as soon as the part meets something."""

    @staticmethod
    def of(name: str, motion: WayAndLine) -> Lower:
        """The phase for a type of part."""
        doing, on_line = Message("carrying {name}", name=name), Message("lowering {name}", name=name)
        return Lower(doing, motion, on_line, holding=name)

    def poll(self, observation: Observation, command: Command) -> Progress:
        """Follow the way and feel."""
        progress = super().poll(observation, command)
        if progress.status is SkillStatus.SUCCESS or not observation.gripper.holding:
            return progress
        if not self.only_line(observation, BLENDED_S):
            return progress
        lag_m = None if self.only_line(observation) else BLENDED_LAG_M
        stuck = progress.status is SkillStatus.FAILURE and can_feel(self, observation)
        if stuck or meets_something(self.motion.planner, self, observation, lag_m=lag_m):
            return failed(Message("lowering {name}: it met something above its hole", name=self.holding))
        return progress


@dataclass(eq=False)
class Descend:
    """A phase: over a part and straight down to it, which ends in failure as soon as the fingers meet something.

    The fingers open on the way; where they are late, the arm stops above. Around a part that was let go in its hole
    they do not close: they get their opening once the tool has left it.

    Attributes:
        name: type of the part.
        above_rad: joints (n,) over the part.
        load: of the way over the part.
        line: down to it, with the fingers open as far.
        feels: what the fingers meet may be what the part lies on: they close there.
    """

    name: str
    planner: MotionPlanner = field(repr=False)
    above_rad: Array
    load: Load
    line: Line
    feels: bool = field(default=False, kw_only=True)
    _told: bool = field(default=False, init=False)
    _rest: FingersRest | None = field(default=None, init=False)
    _move: WayDown | None = field(default=None, init=False)

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
            self._rest, self._move = FingersRest("opening the fingers", self.planner.settings), None
            return Progress(SkillStatus.RUNNING, "opening the fingers")
        felt = move.only_line(observation) and meets_something(self.planner, move, observation)
        if progress.status is SkillStatus.RUNNING and felt:
            if self.feels:
                command.follow, command.stop_arm = None, True
                return done(Message("the fingers feel what {name} lies on", name=self.name))
            return failed(Message("the fingers met something on the way down to {name}", name=self.name))
        return progress

    def _open(self, observation: Observation, command: Command) -> None:
        if self._told or held(observation):
            return
        self.planner.forget_left(np.array(observation.arm.positions_rad))
        opening_m, settings = self.line.load.opening_m, self.planner.settings
        if self.planner.around is None or opening_m >= observation.gripper.opening_m:
            command.gripper = GripperCommand(opening_m, settings.gripper_speed_m_s, settings.grip_force_n)
            self._told = True

    def _way(self, observation: Observation) -> WayDown:
        """With the fingers as wide as they still stand around a part."""
        over = self.load
        if not self._told:
            over = replace(
                over, opening_m=self.planner.settings.gripper.within(max(over.opening_m, observation.gripper.opening_m))
            )
        return WayDown(
            Message("moving above {name}", name=self.name),
            WayAndLine(self.planner, self.above_rad, over, self.line, FELT),
            Message("going down to {name}", name=self.name),
        )


@dataclass(eq=False)
class SetDown:
    """A phase: straight down with the held part until it is there, or until it rests on something near there.

    A part that somebody has pulled down or tilted in the fingers meets the ground too early for the tool.

    Attributes:
        name: type of the held part.
        line: to where it is let go.
        slipped_m: contact this far above the goal may still be the ground; higher up it is something else.
    """

    name: str
    line: Line
    slipped_m: float
    _move: Move = field(init=False)

    def __post_init__(self) -> None:
        self._move = Move(Message("lowering {name}", name=self.name), self.line, holding=self.name)

    def poll(self, observation: Observation, command: Command) -> Progress:
        """Lower and feel."""
        progress = self._move.poll(observation, command)
        if progress.status is SkillStatus.SUCCESS or not observation.gripper.holding:
            return progress
        stuck = progress.status is SkillStatus.FAILURE and can_feel(self._move, observation)
        planner = self.line.planner
        if not stuck and not meets_something(planner, self._move, observation):
            return progress
        above_m = tool_height_m(planner, observation) - self.line.world_from_tool.position_m[2]
        if above_m > self.slipped_m:
            return failed(
                Message(
                    "lowering {name}: it met something {above_m} mm above where it should rest",
                    name=self.name,
                    above_m=f"{above_m * 1000:.0f}",
                )
            )
        command.follow, command.stop_arm = None, True
        return done(
            Message("{name} rests {above_m} mm higher than expected", name=self.name, above_m=f"{above_m * 1000:.0f}")
        )


@dataclass(eq=False)
class Insert:
    """A phase: slow descents, each ended by the goal or by contact, until one goes all the way.

    The error of a grasp lies along the tool's y: along its x the fingers have centred the part between them.

    Attributes:
        name: type of the held part.
        goal: world_from_tool when it is let go.
        depth_m: the descents start this far above the goal.
    """

    name: str
    planner: MotionPlanner = field(repr=False)
    goal: Pose
    depth_m: float
    load: Load
    _shifts_m: list[float] = field(init=False)
    _descending: bool = field(default=True, init=False)
    _move: Move = field(init=False)

    def __post_init__(self) -> None:
        self._shifts_m = [0.0, *self.planner.settings.search_shifts_m]
        self._move = self._descent()

    def poll(self, observation: Observation, command: Command) -> Progress:
        """Lower, feel, and go back up where there was contact."""
        progress = self._move.poll(observation, command)
        if not self._descending:
            if progress.status is SkillStatus.SUCCESS:
                self._descending, self._move = True, self._descent()
                return self._move.poll(observation, command)
            return progress
        if progress.status is SkillStatus.FAILURE or not meets_something(self.planner, self._move, observation):
            return progress
        command.follow, command.stop_arm = None, True
        if tool_height_m(self.planner, observation) - self.goal.position_m[2] < RESTS_M:
            return done(Message("{name} rests on the bracket", name=self.name))
        self._shifts_m.pop(0)
        if not self._shifts_m:
            return failed(Message("the peg of {name} does not find its hole", name=self.name))
        self._descending, self._move = False, self._way_back()
        return Progress(SkillStatus.RUNNING, Message("{name} met the rim", name=self.name))

    def _descent(self) -> Move:
        return self._line(Message("lowering {name}", name=self.name), 0.0, self.planner.settings.insertion_speed_m_s)

    def _way_back(self) -> Move:
        return self._line(
            Message("trying {name} {shifts_m} mm beside", name=self.name, shifts_m=f"{self._shifts_m[0] * 1000:+.1f}"),
            self.depth_m,
            None,
        )

    def _line(self, doing: str, rise_m: float, speed_m_s: float | None) -> Move:
        shifted = self.goal @ Pose((0.0, self._shifts_m[0], -rise_m))
        return Move(doing, Line(self.planner, shifted, self.load, speed_m_s), holding=self.name)
