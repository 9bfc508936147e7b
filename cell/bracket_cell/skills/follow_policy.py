"""Let a trained policy lead the arm, a motion at a time, as far as zone, collisions and the supervisor allow."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from bracket_cell.skills.grasping.handling import joints_of
from bracket_cell.skills.grasping.phases import done, failed
from bracket_cell.skills.motion.planner import Load, MotionPlanner, Plan
from bracket_cell.skills.motion.trajectory import joint_move
from bracket_cell.skills.move_to import FreeMove
from bracket_ground.errors import ModelError
from bracket_ground.files.words.message import Message
from bracket_ground.interfaces.command import Command
from bracket_ground.interfaces.observation import Observation
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.skill import Progress, SkillStatus

SETTLED_RAD = 0.01  # a policy that wants the arm no farther than this from where it stands is done
STEP_M, STEP_RAD = 0.04, 0.3  # the largest step of a policy that answers with steps
STEPS = ("x", "y", "z", "turn")
Zone = tuple[float, float, float, float, float, float]  # least and largest x, y, z of the tool in the world [m]


@dataclass(eq=False)
class FollowPolicy(FreeMove):
    """Move where the policy wants the arm by a free way, and ask again, until it wants it where it stands.

    Attributes:
        zone: the tool never goes out of it.
        steps: motions at most.
    """

    to: str = field(default="where the policy wants it", init=False)
    zone: Zone = field(kw_only=True)
    steps: int = field(kw_only=True)
    _rows: list[Array] = field(default_factory=list, init=False)
    _goal_rad: Array | None = field(default=None, init=False)
    _moved: bool = field(default=True, init=False)

    def asks(self, observation: Observation) -> bool:
        """Whether it needs the policy's answer, and the arm stands for it."""
        arm = observation.arm
        return self._end is None and self._goal_rad is None and not self._rows and arm.stands and not arm.moving

    def feed(self, rows: Sequence[Array]) -> None:
        """What the policy wants: joints (n,) in [rad] or steps (4,), one after the other."""
        self._rows, self._moved, self._waits_since_s = list(rows), False, None

    def goal(self, observation: Observation, load: Load) -> Array | str:  # noqa: ARG002
        joints = self._goal_rad
        assert joints is not None, "nothing is planned without"
        robot = self.planner.settings.robot
        if not robot.within(joints).all():
            legal = " to ".join(str(np.round(side, 3).tolist()) for side in robot.limits_rad)
            return f"the policy wants joints {np.round(joints, 3).tolist()} rad; legal: {legal}"
        tool_m = self.planner.kinematics.position_m(joints)
        least, most = np.array(self.zone).reshape(3, 2).T
        if (tool_m < least).any() or (tool_m > most).any():
            return f"the policy wants the tool at {np.round(tool_m, 3).tolist()} m, outside of its zone"
        return joints

    def poll(self, observation: Observation, command: Command) -> Progress:
        asking = Progress(SkillStatus.RUNNING, "asking the policy")
        if self._end is None and self._goal_rad is None:
            try:
                goal = self._next(joints_of(observation))
            except ModelError as error:
                return self._finish(failed(str(error)))
            if goal is None and self._moved:
                return asking if observation.arm.stands and not observation.arm.moving else self._wait(observation)
            if goal is None:
                return self._finish(done(self.done))
            self._goal_rad, self._moved = goal, True
            self.steps -= 1
            if self.steps < 0:
                return self._finish(failed("the policy did not come to rest in the motions that it may make"))
        progress = super().poll(observation, command)
        if progress.status is not SkillStatus.SUCCESS:
            return progress
        self._phases = self._end = self._goal_rad = None
        return asking

    def _next(self, arm_rad: Array) -> Array | None:
        """The next goal that is not where the arm stands; None where the policy's last answer has none left."""
        while self._rows:
            row = self._rows.pop(0)
            joints = joints_after(self.planner, arm_rad, row) if len(row) == len(STEPS) else row
            if np.abs(joints - arm_rad).max() > SETTLED_RAD:
                return joints
        return None


def step_goal(motion: MotionPlanner, start_rad: Array, step: Array) -> Pose:
    """Where the tool is after a step (4,): shares from -1 to 1 of STEP_M along x, y and z, of STEP_RAD about z."""
    tool = motion.kinematics.forward(start_rad)
    by = np.clip(np.asarray(step, np.float64), -1.0, 1.0)
    x, y, z = (float(at + STEP_M * share) for at, share in zip(tool.position_m, by[:3], strict=True))
    half = 0.5 * STEP_RAD * float(by[3])
    turn = Pose((0.0, 0.0, 0.0), (math.cos(half), 0.0, 0.0, math.sin(half)))
    return Pose((x, y, z), (turn @ Pose((0.0, 0.0, 0.0), tool.quaternion_wxyz)).quaternion_wxyz)


def stepped(motion: MotionPlanner, start_rad: Array, step: Array, opening_m: float) -> Plan:
    """A motion by a step, all joints in phase, or why it is not free, in words."""
    try:
        way = joint_move(start_rad, joints_after(motion, start_rad, step), motion.settings)
    except ModelError as error:
        return str(error)
    contact = motion.scene(Load(opening_m, close=True)).first_contact(way.positions_rad)
    return way if contact is None else Message("no free way: {contact}", contact=contact)


def joints_after(motion: MotionPlanner, start_rad: Array, step: Array) -> Array:
    """Where the joints are after a step, (6,).

    Raises:
        ModelError: the arm cannot be there.
    """
    joints = motion.kinematics.follow(step_goal(motion, start_rad, step), start_rad)
    if joints is None:
        raise ModelError(f"the policy wants a step {np.round(step, 2).tolist()} where the arm cannot go")
    return joints
