"""Bring the arm to joints or to a pose of its tool by a free way, also by one that was planned, and seen, before."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Literal

import numpy as np

from cell.files.words.message import Message
from cell.interfaces.command import Command, JointTrajectory
from cell.interfaces.faults import HAND_TOO_NEAR
from cell.interfaces.observation import Observation
from cell.interfaces.perception import PartDetection
from cell.interfaces.pose import Array, Pose
from cell.interfaces.skill import Progress
from skills.grasping.handling import IN_HOLE, bracket_boxes, carried, joints_of, seen_in_holes, tray_boxes
from skills.grasping.phases import Move, Phase, PhasedSkill
from skills.motion.grip import STROKE_M
from skills.motion.near_hand import way_out
from skills.motion.planner import Load, Looking, MotionPlanner, Plan, Planning, settled

NamedPose = Literal["park", "look"]
SAME_RAD = 0.02  # a way that was approved is still the same where no joint differs by more


class Leave(Move):
    """A motion that may begin with open fingers around a part; it tells so until the tool has left that."""

    def __init__(self, doing: str, plan: Planning, planner: MotionPlanner, *, holding: str | None) -> None:
        super().__init__(doing, plan, planner.settings, holding=holding)
        self._planner, self._goes = planner, doing

    def poll(self, observation: Observation, command: Command) -> Progress:
        """Follow it, and notice that the tool has left."""
        self._planner.forget_left(joints_of(observation))
        around = self._planner.around
        self._doing = (
            self._goes if around is None else Message("leaving {name}", name=around.name.removesuffix(IN_HOLE))
        )
        return super().poll(observation, command)


class FreeMove(PhasedSkill):
    """Base of the motions by a free way; a subclass says where to."""

    def __init__(
        self, planner: MotionPlanner, to: str, standing: Sequence[PartDetection] = (), held: str | None = None
    ) -> None:
        """Args:
        to: where the arm goes, in words.
        standing: parts that stand in the tray or were put down elsewhere; the arm keeps clear of them.
        held: type of the part that the gripper holds, if it holds one.
        """
        super().__init__()
        self._planner, self._to, self._standing, self._held = planner, to, tuple(standing), held

    def goal(self, observation: Observation, load: Load) -> Array | str:
        """Joints (6,) to go to, or why there are none."""
        raise NotImplementedError

    def prepare(self, observation: Observation) -> Sequence[Phase] | str:
        """One motion."""
        held, _ = carried(self._planner, self._held, observation)
        way = self._way(observation)
        return (
            way
            if isinstance(way, str)
            else [Leave(Message("moving to {to}", to=self._to), way, self._planner, holding=held)]
        )

    def plan(self, observation: Observation) -> Plan:
        """How it would move from where the arm stands, or why it cannot; nothing moves."""
        way = self._way(observation)
        return way if isinstance(way, str) else settled(way(joints_of(observation)))

    def _way(self, observation: Observation) -> Planning | str:
        """What plans the motion when it begins, or why there is none."""
        planner = self._planner
        _, boxes = carried(planner, self._held, observation)
        obstacles = (*bracket_boxes(planner, seen_in_holes(observation)), *tray_boxes(planner, self._standing))
        load = Load(min(STROKE_M, max(0.0, observation.gripper.opening_m)), obstacles, boxes)
        goal = self.goal(observation, load)
        if isinstance(goal, str):
            return Message("cannot move to {to}: {goal}", to=self._to, goal=goal)
        return partial(self.way, observation, goal, load)

    def way(self, observation: Observation, goal_rad: Array, load: Load, start_rad: Array) -> Plan | Looking:
        """How to get there; where a near hand holds the arm, by a way that leads away from it, if there is one."""
        planner = self._planner
        if HAND_TOO_NEAR in observation.held_by:
            path = way_out(planner, observation, start_rad, goal_rad, load)
            if not isinstance(path, str):
                return path
        return planner.free_way(start_rad, goal_rad, load)

    @property
    def done(self) -> str:
        """What the skill has achieved, in words."""
        return Message("arm at {to}", to=self._to)


class MoveTo(FreeMove):
    """Move to joints that the bench names."""

    def __init__(
        self,
        planner: MotionPlanner,
        pose: NamedPose,
        standing: Sequence[PartDetection] = (),
        held: str | None = None,
    ) -> None:
        super().__init__(planner, pose, standing, held)
        self._pose = pose

    def goal(self, observation: Observation, load: Load) -> Array | str:  # noqa: ARG002
        """The joints of that name; parked, the two fingers may be turned by half turns, as nothing there depends on it.

        Of those the one is chosen by which the arm comes there and on to the look the soonest.
        """
        planner = self._planner
        park, look = np.array(planner.bench.arm_park_rad), np.array(planner.bench.arm_look_rad)
        if self._pose == "look":
            return look

        def takes_s(joints: Array) -> tuple[float, float]:
            way_s = planner.travel_s(joints - joints_of(observation))
            return round(way_s + planner.travel_s(look - joints), 3), way_s

        turned = list(park + np.pi * np.arange(-2, 3)[:, np.newaxis] * (np.arange(6) == 5))
        chosen: Array = min((joints for joints in turned if planner.kinematics.within_limits(joints)), key=takes_s)
        return chosen


class GiveWay(MoveTo):
    """Go to the parking place out of a near hand's way: by a way that leads away from it all along, or not at all."""

    def __init__(self, planner: MotionPlanner, standing: Sequence[PartDetection] = (), held: str | None = None) -> None:
        super().__init__(planner, "park", standing, held)

    def way(self, observation: Observation, goal_rad: Array, load: Load, start_rad: Array) -> Plan:
        """The way out."""
        return way_out(self._planner, observation, start_rad, goal_rad, load)

    @property
    def done(self) -> str:
        """What the skill has achieved, in words."""
        return "out of the hand's way"


class MoveToJoints(FreeMove):
    """Move to joints (6,) in [rad]."""

    def __init__(
        self,
        planner: MotionPlanner,
        joints_rad: Array,
        standing: Sequence[PartDetection] = (),
        held: str | None = None,
    ) -> None:
        super().__init__(planner, "the joints", standing, held)
        self._joints = joints_rad

    def goal(self, observation: Observation, load: Load) -> Array | str:  # noqa: ARG002
        """The joints, if the arm has them."""
        within = self._planner.kinematics.within_limits(self._joints)
        return self._joints if within else "they lie beyond the arm's limits"


class MoveToPose(FreeMove):
    """Move the tool (TCP) to a pose in the world."""

    def __init__(
        self,
        planner: MotionPlanner,
        world_from_tool: Pose,
        to: str,
        standing: Sequence[PartDetection] = (),
        held: str | None = None,
    ) -> None:
        super().__init__(planner, to, standing, held)
        self._pose = world_from_tool

    def goal(self, observation: Observation, load: Load) -> Array | str:
        """Joints for the pose, near to where the arm stands."""
        found = self._planner.reach([self._pose], joints_of(observation), load)
        return found if isinstance(found, str) else found[1]


class FollowPlan(FreeMove):
    """Move as planned before; not at all where the way has become another one, as nobody has approved that."""

    def __init__(
        self,
        planner: MotionPlanner,
        plan: JointTrajectory,
        to: str,
        standing: Sequence[PartDetection] = (),
        held: str | None = None,
    ) -> None:
        super().__init__(planner, to, standing, held)
        self._plan = plan

    def goal(self, observation: Observation, load: Load) -> Array | str:  # noqa: ARG002
        """The end of the plan."""
        end: Array = self._plan.positions_rad[-1]
        return end

    def way(self, observation: Observation, goal_rad: Array, load: Load, start_rad: Array) -> Looking:  # noqa: ARG002
        """The plan made again with what is seen now, if it is the same."""
        found = self._planner.free_way(start_rad, goal_rad, load)
        for now in (found,) if isinstance(found, JointTrajectory | str) else found:
            yield now if now is None else self._same(now)

    def _same(self, now: Plan) -> Plan:
        if isinstance(now, str):
            return now
        shares = np.linspace(0.0, 1.0, 50)
        before, after = (one.along(shares * one.duration_s) for one in (self._plan, now))
        same = np.abs(before - after).max() <= SAME_RAD
        return now if same else "the way is not the one that was planned; plan again"
