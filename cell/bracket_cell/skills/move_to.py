"""Bring the arm to joints or to a pose of its tool by a free way, also by one that was planned, and seen, before."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from bracket_cell.skills.grasping.handling import IN_HOLE, bracket_boxes, carried, joints_of, seen_in_holes, tray_boxes
from bracket_cell.skills.grasping.phases import Move, Phase, PhasedSkill
from bracket_cell.skills.motion.motions import Motion, SameWay, WayOut, WayOutOrFree
from bracket_cell.skills.motion.planner import Load, MotionPlanner, Plan, settled
from bracket_ground.files.words.message import Message
from bracket_ground.interfaces.command import Command, JointTrajectory
from bracket_ground.interfaces.observation import Observation
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.skill import Progress


@dataclass(eq=False)
class Leave(Move):
    """A motion that may begin with open fingers around a part; it tells so until the tool has left that."""

    _goes: str = field(default="", init=False)

    def __post_init__(self) -> None:
        self._goes = self.doing

    def poll(self, observation: Observation, command: Command) -> Progress:
        """Follow it, and notice that the tool has left."""
        planner = self.motion.planner
        planner.forget_left(joints_of(observation))
        around = planner.around
        self.doing = self._goes if around is None else Message("leaving {name}", name=around.name.removesuffix(IN_HOLE))
        return super().poll(observation, command)


@dataclass(eq=False)
class FreeMove(PhasedSkill):
    """Base of the motions by a free way; a subclass says where to.

    Attributes:
        to: where the arm goes, in words.
        standing: parts that stand in the tray or were put down elsewhere; the arm keeps clear of them.
        held: type of the part that the gripper holds, if it holds one.
    """

    planner: MotionPlanner = field(repr=False)
    to: str
    standing: Sequence[PartDetection] = ()
    held: str | None = None

    def goal(self, observation: Observation, load: Load) -> Array | str:
        """Joints (n,) to go to, or why there are none."""
        raise NotImplementedError

    def prepare(self, observation: Observation) -> Sequence[Phase] | str:
        """One motion."""
        held, _ = carried(self.planner, self.held, observation)
        way = self._way(observation)
        return way if isinstance(way, str) else [Leave(Message("moving to {to}", to=self.to), way, holding=held)]

    def plan(self, observation: Observation) -> Plan:
        """How it would move from where the arm stands, or why it cannot; nothing moves."""
        way = self._way(observation)
        return way if isinstance(way, str) else settled(way.plan(joints_of(observation)))

    def _way(self, observation: Observation) -> Motion | str:
        """The motion, or why there is none."""
        planner = self.planner
        _, boxes = carried(planner, self.held, observation)
        obstacles = (*bracket_boxes(planner, seen_in_holes(observation)), *tray_boxes(planner, self.standing))
        load = Load(planner.settings.gripper.within(observation.gripper.opening_m), obstacles, boxes)
        goal = self.goal(observation, load)
        if isinstance(goal, str):
            return Message("cannot move to {to}: {goal}", to=self.to, goal=goal)
        return self.motion(observation, goal, load)

    def motion(self, observation: Observation, goal_rad: Array, load: Load) -> Motion:
        """How to get there."""
        return WayOutOrFree(self.planner, goal_rad, load, observation)

    @property
    def done(self) -> str:
        """What the skill has achieved, in words."""
        return Message("arm at {to}", to=self.to)


@dataclass(eq=False)
class MoveTo(FreeMove):
    """Move to joints that the bench names: `park` or `look`."""

    def goal(self, observation: Observation, load: Load) -> Array | str:  # noqa: ARG002
        """The joints of that name; parked, the two fingers may be turned by half turns, as nothing there depends on it.

        Of those the one is chosen by which the arm comes there and on to the look the soonest.
        """
        planner = self.planner
        park, look = np.array(planner.bench.arm_park_rad), np.array(planner.bench.arm_look_rad)
        if self.to == "look":
            return look

        def takes_s(joints: Array) -> tuple[float, float]:
            way_s = planner.travel_s(joints - joints_of(observation))
            return round(way_s + planner.travel_s(look - joints), 3), way_s

        turned = list(park + np.pi * np.arange(-2, 3)[:, np.newaxis] * (np.arange(len(park)) == len(park) - 1))
        chosen: Array = min((joints for joints in turned if planner.kinematics.within_limits(joints)), key=takes_s)
        return chosen


@dataclass(eq=False)
class GiveWay(MoveTo):
    """Go to the parking place out of a near hand's way: by a way that leads away from it all along, or not at all."""

    to: str = field(default="park", init=False)

    def motion(self, observation: Observation, goal_rad: Array, load: Load) -> Motion:
        """The way out."""
        return WayOut(self.planner, goal_rad, load, observation)

    @property
    def done(self) -> str:
        """What the skill has achieved, in words."""
        return "out of the hand's way"


@dataclass(eq=False)
class MoveToJoints(FreeMove):
    """Move to joints (n,) in [rad]."""

    to: str = field(default="the joints", init=False)
    joints_rad: Array = field(kw_only=True)

    def goal(self, observation: Observation, load: Load) -> Array | str:  # noqa: ARG002
        """The joints, if the arm has them."""
        within = self.planner.kinematics.within_limits(self.joints_rad)
        return self.joints_rad if within else "they lie beyond the arm's limits"


@dataclass(eq=False)
class MoveToPose(FreeMove):
    """Move the tool (TCP) to a pose in the world."""

    world_from_tool: Pose = field(kw_only=True)

    def goal(self, observation: Observation, load: Load) -> Array | str:
        """Joints for the pose, near to where the arm stands."""
        found = self.planner.reach([self.world_from_tool], joints_of(observation), load)
        return found if isinstance(found, str) else found[1]


@dataclass(eq=False)
class FollowPlan(FreeMove):
    """Move as planned before; not at all where the way has become another one, as nobody has approved that."""

    approved: JointTrajectory = field(kw_only=True)

    def goal(self, observation: Observation, load: Load) -> Array | str:  # noqa: ARG002
        """The end of the plan."""
        end: Array = self.approved.positions_rad[-1]
        return end

    def motion(self, observation: Observation, goal_rad: Array, load: Load) -> Motion:  # noqa: ARG002
        """The plan made again with what is seen now, if it is the same."""
        return SameWay(self.planner, goal_rad, load, self.approved)
