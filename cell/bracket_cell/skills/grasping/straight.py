"""The tool on a straight line: to a pose with a speed, or on until it meets something."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from bracket_cell.skills.grasping.contact import meets_something
from bracket_cell.skills.grasping.handling import bracket_boxes, carried, joints_of, seen_in_holes, tray_boxes
from bracket_cell.skills.grasping.phases import Move, Phase, PhasedSkill, done, failed
from bracket_cell.skills.motion.motions import Blind, Line
from bracket_cell.skills.motion.planner import Load, MotionPlanner
from bracket_ground.files.words.message import Message
from bracket_ground.interfaces.command import Command
from bracket_ground.interfaces.observation import Observation
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.pose import FINGERS_DOWN, Array, Pose
from bracket_ground.interfaces.skill import Progress, SkillStatus


@dataclass(eq=False)
class StraightMove(PhasedSkill):
    """Move the tool (TCP) on a straight line.

    Attributes:
        target: world_from_tool at the end.
        to: where it goes, in words.
        standing: parts that the arm keeps clear of.
        held: type of the part that the gripper holds, if it holds one.
    """

    planner: MotionPlanner = field(repr=False)
    target: Pose
    to: str
    speed_m_s: float
    standing: Sequence[PartDetection] = ()
    held: str | None = None

    def end(self, world_from_tool: Pose) -> Pose:  # noqa: ARG002
        """world_from_tool at the end, from where the tool is at the start."""
        return self.target

    def prepare(self, observation: Observation) -> Sequence[Phase] | str:
        """One line."""
        planner = self.planner
        held, boxes = carried(planner, self.held, observation)
        obstacles = (*bracket_boxes(planner, seen_in_holes(observation)), *tray_boxes(planner, self.standing))
        load = Load(planner.settings.gripper.within(observation.gripper.opening_m), obstacles, boxes, close=True)
        end = self.end(planner.kinematics.forward(joints_of(observation)))
        line = Line(planner, end, load, self.speed_m_s)
        return [Move(Message("moving straight to {to}", to=self.to), line, holding=held)]

    @property
    def done(self) -> str:
        """What the skill has achieved, in words."""
        return Message("tool at {to}", to=self.to)


@dataclass(eq=False)
class StraightMoveBy(StraightMove):
    """Move the tool on a straight line by a way from where it is; `target` is that way, and how much it turns.

    Attributes:
        axes: of the way, in the world.
    """

    axes: Pose = field(kw_only=True)

    def end(self, world_from_tool: Pose) -> Pose:
        return moved_by(world_from_tool @ FINGERS_DOWN, self.axes, self.target) @ FINGERS_DOWN


def moved_by(start: Pose, axes: Pose, by: Pose) -> Pose:
    """A pose in the world after a way along the axes of a frame, turned about the same axes where it then is."""
    x, y, z = (float(value) for value in np.array(start.position_m) + axes.rotation @ np.array(by.position_m))
    turned = np.eye(4)
    turned[:3, :3] = axes.rotation @ by.rotation @ axes.rotation.T @ start.rotation
    return Pose((x, y, z), Pose.from_matrix(turned).quaternion_wxyz)


@dataclass(eq=False)
class MoveUntilContact(PhasedSkill):
    """Move the tool on a straight line until it meets something, and stop there; nothing met is a failure.

    Attributes:
        by_m: the longest way, (3,) in the world.
    """

    planner: MotionPlanner = field(repr=False)
    by_m: Array
    speed_m_s: float

    def prepare(self, observation: Observation) -> Sequence[Phase] | str:
        """One line, felt along; obstacles are not avoided, as one of them is looked for."""
        length_m = float(np.linalg.norm(self.by_m))
        if length_m < 1e-4:
            return "the way until contact has no length"
        pose = self.planner.kinematics.forward(joints_of(observation))
        x, y, z = (float(value) for value in np.array(pose.position_m) + self.by_m)
        line = Blind(self.planner, Pose((x, y, z), pose.quaternion_wxyz), self.speed_m_s)
        return [_Feel("feeling the way", line, self.by_m / np.linalg.norm(self.by_m))]

    @property
    def done(self) -> str:
        """What the skill has achieved, in words."""
        return "the tool met something"


@dataclass(eq=False)
class _Feel(Move):
    """A phase: along a line, which succeeds as soon as something holds the tool back.

    Attributes:
        along: direction of the line, (3,) in the world.
    """

    along: Array

    def poll(self, observation: Observation, command: Command) -> Progress:
        """Follow the line and feel."""
        progress = super().poll(observation, command)
        if progress.status is SkillStatus.FAILURE:
            return progress
        if meets_something(self.motion.planner, self, observation, self.along):
            command.follow, command.stop_arm = None, True
            return done("met something")
        return failed("nothing was met on the whole way") if progress.status is SkillStatus.SUCCESS else progress
