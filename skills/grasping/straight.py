"""The tool on a straight line: to a pose with a speed, or on until it meets something."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from cell.files.words.message import Message
from cell.interfaces.command import Command
from cell.interfaces.observation import Observation
from cell.interfaces.perception import PartDetection
from cell.interfaces.pose import Array, Pose
from cell.interfaces.skill import Progress, SkillStatus
from skills.grasping.contact import meets_something
from skills.grasping.handling import bracket_boxes, carried, joints_of, seen_in_holes, tray_boxes
from skills.grasping.phases import Move, Phase, PhasedSkill, done, failed
from skills.motion.grip import STROKE_M
from skills.motion.planner import Load, MotionPlanner, Plan


class StraightMove(PhasedSkill):
    """Move the tool (TCP) on a straight line."""

    def __init__(
        self,
        planner: MotionPlanner,
        target: Callable[[Pose], Pose],
        to: str,
        speed_m_s: float,
        standing: Sequence[PartDetection] = (),
        held: str | None = None,
    ) -> None:
        """Args:
        target: world_from_tool at the end, from where the tool is at the start.
        to: where it goes, in words.
        standing: parts that the arm keeps clear of.
        held: type of the part that the gripper holds, if it holds one.
        """
        super().__init__()
        self._planner, self._target, self._to, self._speed_m_s = planner, target, to, speed_m_s
        self._standing, self._held = tuple(standing), held

    def prepare(self, observation: Observation) -> Sequence[Phase] | str:
        """One line."""
        planner = self._planner
        held, boxes = carried(planner, self._held, observation)
        obstacles = (*bracket_boxes(planner, seen_in_holes(observation)), *tray_boxes(planner, self._standing))
        load = Load(min(STROKE_M, max(0.0, observation.gripper.opening_m)), obstacles, boxes, close=True)
        target = self._target(planner.kinematics.forward(joints_of(observation)))
        return [
            Move(
                Message("moving straight to {to}", to=self._to),
                lambda start: planner.straight_move(start, target, load, self._speed_m_s),
                planner.settings,
                holding=held,
            )
        ]

    @property
    def done(self) -> str:
        """What the skill has achieved, in words."""
        return Message("tool at {to}", to=self._to)


class MoveUntilContact(PhasedSkill):
    """Move the tool on a straight line until it meets something, and stop there; nothing met is a failure."""

    def __init__(self, planner: MotionPlanner, by_m: Array, speed_m_s: float) -> None:
        """Args:
        by_m: the longest way, (3,) in the world.
        """
        super().__init__()
        self._planner, self._by_m, self._speed_m_s = planner, by_m, speed_m_s

    def prepare(self, observation: Observation) -> Sequence[Phase] | str:  # noqa: ARG002
        """One line, felt along; obstacles are not avoided, as one of them is looked for."""
        length_m = float(np.linalg.norm(self._by_m))
        if length_m < 1e-4:
            return "the way until contact has no length"
        return [_Feel(self._planner, self._by_m, self._speed_m_s)]

    @property
    def done(self) -> str:
        """What the skill has achieved, in words."""
        return "the tool met something"


class _Feel:
    """A phase: along a line, which succeeds as soon as something holds the tool back."""

    def __init__(self, planner: MotionPlanner, by_m: Array, speed_m_s: float) -> None:
        self._planner, self._along = planner, by_m / np.linalg.norm(by_m)

        self._goal: Pose | None = None

        def plan(start_rad: Array) -> Plan:
            if self._goal is None:  # a way that begins again ends where the first one would have ended
                pose = planner.kinematics.forward(start_rad)
                x, y, z = (float(value) for value in np.array(pose.position_m) + by_m)
                self._goal = Pose((x, y, z), pose.quaternion_wxyz)
            return planner.blind_move(start_rad, self._goal, speed_m_s)

        self._move = Move("feeling the way", plan, planner.settings)

    def poll(self, observation: Observation, command: Command) -> Progress:
        """Follow the line and feel."""
        progress = self._move.poll(observation, command)
        if progress.status is SkillStatus.FAILURE:
            return progress
        if meets_something(self._planner, self._move, observation, self._along):
            command.follow, command.stop_arm = None, True
            return done("met something")
        return failed("nothing was met on the whole way") if progress.status is SkillStatus.SUCCESS else progress
