"""Motion phases that skills are made of, and the skill that runs phases one after the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import numpy as np

from bracket_cell.skills.motion.motions import Motion
from bracket_cell.skills.motion.planner import Looking, Plan
from bracket_cell.skills.motion.settings import MotionSettings
from bracket_ground.files.words.message import Message
from bracket_ground.interfaces.command import Command, GripperCommand, HandCommand, JointTrajectory
from bracket_ground.interfaces.observation import ObjectStatus, Observation
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.skill import Progress, SkillStatus

KNOCKED_M = 0.003  # so far apart from where they gripped a part, fingers still grip it
DROPPED_TICKS = 3  # the fingers may settle for a moment without having lost the part
TAKEN_S = 0.2  # after this an arm has taken its trajectory
BEGIN_AGAIN = 2  # times that a motion is planned anew where the arm lost its trajectory
ACTIVATION_TIMEOUT_S = 10.0
STOP_TIMEOUT_S = 5.0


@runtime_checkable
class Phase(Protocol):
    """One step of a skill, polled until it does not answer RUNNING; a dataclass, so that a log can keep it."""

    def poll(self, observation: Observation, command: Command) -> Progress:
        """Carry on; the first call starts the phase."""
        ...


@dataclass(eq=False)
class Move:
    """Follow a trajectory that is planned when the phase starts, and wait until the arm stands at its end.

    Attributes:
        doing: what it does, in words.
        holding: type of the part that the gripper must not lose on the way.
        trajectory, started_s: what the arm follows and since when; None before the start.
    """

    doing: str
    motion: Motion
    holding: str | None = field(default=None, kw_only=True)
    trajectory: JointTrajectory | None = field(default=None, init=False)
    started_s: float = field(default=0.0, init=False)
    _started_worked_s: float = field(default=0.0, init=False)
    _deadline_s: float | None = field(default=None, init=False)
    _asked: Command | None = field(default=None, init=False)
    _looking: Looking | None = field(default=None, init=False)
    _empty_ticks: int = field(default=0, init=False)
    _begun_again: int = field(default=0, init=False)

    def poll(self, observation: Observation, command: Command) -> Progress:
        """Wait for standstill, plan and start, then watch."""
        if self._lost(observation):
            return failed(Message("{holding} was dropped while {doing}", holding=self.holding, doing=self.doing))
        if self._deadline_s is None or self._looking is not None:  # a search ends by itself
            self._deadline_s = observation.worked_s + self._timeout_s
        if self._asked is not None and self._asked.follow is not self.trajectory:
            self.trajectory = None  # a skill that was halted later in that tick stopped the arm: begin again
        self._asked = None
        if self.trajectory is None:
            return self._start(observation, command)
        if not observation.arm.moving and observation.arm.stands and self._arrived(observation):
            return done(self.doing)
        if self._given_up(observation):
            self.trajectory, self._begun_again = None, self._begun_again + 1
        return self._running(observation)

    def _start(self, observation: Observation, command: Command) -> Progress:
        if _stopping(observation, command) or not observation.new_path:
            self._looking = None
            return self._running(observation)
        if self._looking is None:
            self.motion.planner.beside.see(observation)
            found = self._planned(np.array(observation.arm.positions_rad))
            self._looking = iter((found,)) if isinstance(found, JointTrajectory | str) else found
        if (plan := next(self._looking)) is None:
            return self._running(observation)
        self._looking = None
        if isinstance(plan, str):
            return failed(Message("{doing}: {plan}", doing=self.doing, plan=plan))
        self.trajectory, self.started_s, self._started_worked_s = plan, observation.time_s, observation.worked_s
        if plan.duration_s == 0:
            return done(self.doing)
        command.follow, self._asked = plan, command
        self._deadline_s = observation.worked_s + plan.duration_s + self._timeout_s
        return Progress(SkillStatus.RUNNING, self.doing)

    def _planned(self, start_rad: Array) -> Plan | Looking:
        return self.motion.plan(start_rad)

    @property
    def _timeout_s(self) -> float:
        return self.motion.planner.settings.arm_timeout_s

    def _lost(self, observation: Observation) -> bool:
        empty = self.holding is not None and not observation.gripper.holding
        self._empty_ticks = self._empty_ticks + 1 if empty else 0
        return self._empty_ticks >= DROPPED_TICKS

    def _given_up(self, observation: Observation) -> bool:
        """Whether the arm has lost its trajectory on the way, as after a protective stop, and may get another."""
        arm, taken_s = observation.arm, observation.time_s - self.started_s
        lost = arm.path_s is None and not arm.moving and arm.stands and taken_s > TAKEN_S
        return lost and not held(observation) and self._begun_again < BEGIN_AGAIN

    def _arrived(self, observation: Observation) -> bool:
        assert self.trajectory is not None
        offset = np.abs(np.array(observation.arm.positions_rad) - self.trajectory.positions_rad[-1])
        return bool(offset.max() < self.motion.planner.settings.arrival_tolerance_rad)

    def _running(self, observation: Observation) -> Progress:
        assert self._deadline_s is not None
        if observation.worked_s > self._deadline_s:
            return failed(Message("{doing}: the arm did not arrive in time", doing=self.doing))
        return Progress(SkillStatus.RUNNING, self.doing)

    def followed_s(self, observation: Observation) -> float:
        """How far along its trajectory the arm should be, as time of the trajectory."""
        path_s = observation.arm.path_s
        if path_s is None or observation.time_s <= self.started_s:  # what the arm tells is of the trajectory before
            return observation.worked_s - self._started_worked_s
        return path_s


@dataclass(eq=False)
class SetGripper:
    """Send a goal to the fingers and wait until they stand.

    With `must_hold` they have to close on something.
    """

    doing: str
    goal: GripperCommand
    settings: MotionSettings = field(repr=False)
    must_hold: bool = field(default=False, kw_only=True)
    _deadline_s: float | None = field(default=None, init=False)

    def poll(self, observation: Observation, command: Command) -> Progress:
        """Send the goal once, then read the object status."""
        if self._deadline_s is None:
            if held(observation) and not (isinstance(self.goal, HandCommand) and observation.new_path):
                return Progress(SkillStatus.RUNNING, self.doing)
            command.gripper = self.goal
            self._deadline_s = observation.worked_s + self.settings.gripper_timeout_s
            return Progress(SkillStatus.RUNNING, self.doing)
        if observation.gripper.object_status is ObjectStatus.MOVING:
            return _fingers_move(self.doing, self.settings, late=observation.worked_s > self._deadline_s)
        if self.must_hold and not observation.gripper.holding:
            if (switched := self.settings.gripper.switched) is not None:  # else it takes something on the way
                command.gripper = GripperCommand(switched.stroke_m)
            return failed(Message("{doing}: nothing between the fingers", doing=self.doing))
        if not self.must_hold and observation.gripper.holding:
            return failed(Message("{doing}: the fingers still hold something", doing=self.doing))
        return done(self.doing)


@dataclass(eq=False)
class FingersRest:
    """Wait until an earlier goal of the fingers is reached."""

    doing: str
    settings: MotionSettings = field(repr=False)
    _deadline_s: float | None = field(default=None, init=False)

    def poll(self, observation: Observation, command: Command) -> Progress:  # noqa: ARG002
        """Read the object status."""
        if self._deadline_s is None:
            self._deadline_s = observation.worked_s + self.settings.gripper_timeout_s
        if observation.gripper.object_status is not ObjectStatus.MOVING:
            return done(self.doing)
        return _fingers_move(self.doing, self.settings, late=observation.worked_s > self._deadline_s)


@dataclass(eq=False)
class Activate:
    """Activate the gripper unless it is."""

    _deadline_s: float | None = field(default=None, init=False)

    def poll(self, observation: Observation, command: Command) -> Progress:
        """Ask once, then wait."""
        if observation.gripper.activated:
            return done("gripper active")
        if self._deadline_s is None and not held(observation):
            command.activate_gripper = True
            self._deadline_s = observation.worked_s + ACTIVATION_TIMEOUT_S
        if self._deadline_s is not None and observation.worked_s > self._deadline_s:
            return failed(
                Message("the gripper did not finish its activation in {timeout_s} s", timeout_s=ACTIVATION_TIMEOUT_S)
            )
        return Progress(SkillStatus.RUNNING, "activating the gripper")


@dataclass(eq=False)
class PhasedSkill:
    """A skill that runs phases one after the other; subclasses, which are dataclasses, too, say which.

    A halt takes several ticks: it orders the stop, and whichever skill comes next begins when the arm stands.
    """

    _phases: list[Phase] | None = field(default=None, init=False, repr=False)
    _waits_since_s: float | None = field(default=None, init=False, repr=False)
    _end: Progress | None = field(default=None, init=False, repr=False)

    def prepare(self, observation: Observation) -> Sequence[Phase] | str:
        """The phases, or why the skill is impossible; nothing has moved yet."""
        raise NotImplementedError

    def poll(self, observation: Observation, command: Command) -> Progress:
        """Carry on; the first call starts the skill, calls after its end repeat its answer."""
        if self._end is not None:
            return self._end
        if self._phases is None:
            if _stopping(observation, command):
                return self._wait(observation)
            phases = self.prepare(observation)
            if isinstance(phases, str):
                return self._finish(failed(phases))
            self._phases = list(phases)
        while self._phases:
            progress = self._phases[0].poll(observation, command)
            if progress.status is SkillStatus.RUNNING:
                return progress
            if progress.status is SkillStatus.FAILURE:
                command.follow, command.stop_arm = None, True
                return self._finish(progress)
            self._phases.pop(0)
        return self._finish(done(self.done))

    @property
    def done(self) -> str:
        """What the skill has achieved, in words."""
        raise NotImplementedError

    def halt(self, command: Command) -> None:
        """Stop the arm within its limits; the fingers keep what they hold."""
        command.follow, command.stop_arm = None, True
        if self._end is None:
            self._end = failed("halted")

    def _wait(self, observation: Observation) -> Progress:
        if self._waits_since_s is None:
            self._waits_since_s = observation.worked_s
        if observation.worked_s - self._waits_since_s > STOP_TIMEOUT_S:
            return self._finish(
                failed(Message("the arm did not come to rest in {timeout_s} s", timeout_s=STOP_TIMEOUT_S))
            )
        return Progress(SkillStatus.RUNNING, "waiting until the arm has stopped")

    def _finish(self, progress: Progress) -> Progress:
        self._end = progress
        return progress


def _stopping(observation: Observation, command: Command) -> bool:
    """Whether the arm still comes to rest, or is told in this very tick to do so."""
    return command.stop_arm or observation.arm.moving or not observation.arm.stands


def held(observation: Observation) -> bool:
    """Whether the supervisor lets nothing begin now."""
    return observation.speed_scale == 0


def done(doing: str) -> Progress:
    """The answer of a phase that has achieved its aim."""
    return Progress(SkillStatus.SUCCESS, doing)


def failed(reason: str) -> Progress:
    """The answer of a phase that cannot go on."""
    return Progress(SkillStatus.FAILURE, reason)


def _fingers_move(doing: str, settings: MotionSettings, *, late: bool) -> Progress:
    """The answer of a phase while the fingers move."""
    if not late:
        return Progress(SkillStatus.RUNNING, doing)
    timeout_s = settings.gripper_timeout_s
    return failed(
        Message("{doing}: the fingers did not come to rest in {timeout_s} s", doing=doing, timeout_s=timeout_s)
    )


@dataclass(eq=False)
class MoveFingers(PhasedSkill):
    """Bring the fingers to an opening, or close them on something."""

    settings: MotionSettings = field(repr=False)
    goal: GripperCommand
    doing: str
    must_hold: bool = field(default=False, kw_only=True)

    def prepare(self, observation: Observation) -> Sequence[Phase] | str:  # noqa: ARG002
        """Activate the gripper if it is not, then one motion."""
        return [Activate(), SetGripper(self.doing, self.goal, self.settings, must_hold=self.must_hold)]

    @property
    def done(self) -> str:
        """What the skill has achieved, in words."""
        return Message("{doing}: done", doing=self.doing)
