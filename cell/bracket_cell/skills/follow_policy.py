"""Let a trained policy lead the arm, a motion at a time, as far as zone, collisions and the supervisor allow."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from bracket_cell.skills.grasping.handling import joints_of
from bracket_cell.skills.grasping.phases import failed
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
    """Ask the policy, move there by a free way, and ask again, until it wants the arm where it stands.

    Attributes:
        wants: the policy's answer to what is seen, the joints in [rad]; raises ModelError.
        zone: the tool never goes out of it.
        steps: motions at most.
    """

    to: str = field(default="where the policy wants it", init=False)
    wants: Callable[[Observation], Array] = field(kw_only=True)
    zone: Zone = field(kw_only=True)
    steps: int = field(kw_only=True)

    def goal(self, observation: Observation, load: Load) -> Array | str:  # noqa: ARG002
        try:
            joints = self.wants(observation)
        except ModelError as error:
            return str(error)
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
        progress = super().poll(observation, command)
        if progress.status is not SkillStatus.SUCCESS:
            return progress
        wanted = self.goal(observation, Load(0.0))
        if isinstance(wanted, str):
            return self._finish(failed(wanted))
        if np.abs(wanted - joints_of(observation)).max() <= SETTLED_RAD:
            return progress
        self.steps -= 1
        if self.steps <= 0:
            return self._finish(failed("the policy did not come to rest in the motions that it may make"))
        self._phases = self._end = None
        return Progress(SkillStatus.RUNNING, "asking the policy again")


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
