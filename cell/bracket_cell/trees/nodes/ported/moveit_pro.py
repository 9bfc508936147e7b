"""MoveIt Pro's behaviors, in the terms of this cell: lists of poses, offsets, waypoints, plans that a person approves.

Its poses and vectors are FramedPose and lists of them; its MTC solution is a PlannedMove. What they do there is in:
https://docs.picknik.ai/behaviors.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from bracket_cell.trees.nodes.asking import Asks
from bracket_cell.trees.nodes.each import ForEach as Each
from bracket_cell.trees.nodes.memory import entries_in, text_of
from bracket_cell.trees.nodes.poses import FramedPose, world_from_tool, world_pose
from bracket_cell.trees.nodes.services import CellNode
from bracket_cell.trees.nodes.skill_node import SkillNode
from bracket_ground.interfaces.command import JointTrajectory
from bracket_ground.interfaces.operator import Answer
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.skill import Skill
from btxml.engine.errors import NodeError
from btxml.engine.node import FAILURE, RUNNING, SUCCESS
from btxml.engine.ports import InOutPort, InputPort, OutputPort
from btxml.engine.status import Status
from btxml.engine.traits import Traits

WAYPOINTS = "waypoints.json"
APPROVE, REJECT = "approve", "reject"
NO_TURN = [0.0, 0.0, 0.0, 1.0]


@dataclass(frozen=True)
class PlannedMove:
    """A motion that nothing follows yet.

    Attributes:
        to: where it goes, in words.
    """

    trajectory: JointTrajectory
    to: str


class ResetPoseStampedVector(CellNode):
    """Make a list of poses empty."""

    traits = Traits(instant=True)

    vector = OutputPort(list[FramedPose], "the list")

    def update(self) -> Status:
        self.vector.set([])
        return SUCCESS


class AddPoseStampedToVector(CellNode):
    """Append a pose to a list, which begins empty."""

    traits = Traits(instant=True)

    input = InputPort(FramedPose, "the pose")
    vector = InOutPort(list[FramedPose], "the list", unset_ok=True)

    def update(self) -> Status:
        self.vector.set([*self.vector.get_or([]), self.input.get()])
        return SUCCESS


class ForEach(Each):
    """Ticks its child once for each item of a list, such as one of poses."""

    vector_in = InputPort(Any, "the list")
    out = OutputPort(Any, "the item of this round")
    index = OutputPort(int, "number of this round, from 0")

    def items(self) -> list[Any]:
        found = self.vector_in.get()
        if not isinstance(found, list | tuple):
            raise NodeError(f"vector_in is a {type(found).__name__}, not a list")
        return list(found)

    def begin(self, item: Any) -> None:
        self.index.set(self._round)
        self.out.set(item)


class OffsetPose(CellNode):
    """Output a pose that is moved along its own axes, and turned about them."""

    traits = Traits(instant=True)

    input_pose = InputPort(FramedPose, "from here")
    translation_xyz = InputPort(list[float], "how far in [m]: 0;0;0.1", default=[0.0, 0.0, 0.0])
    quaternion_xyzw = InputPort(list[float], "how much turned: 0;0;0;1 is not at all", default=NO_TURN)
    output_pose = OutputPort(FramedPose, "to here, in the same frame")

    def update(self) -> Status:
        start = self.input_pose.get()
        x, y, z = _numbers("translation_xyz", self.translation_xyz.get(), 3)
        turn = _numbers("quaternion_xyzw", self.quaternion_xyzw.get(), 4)
        norm = math.hypot(*turn)
        if not 0.9 < norm < 1.1:
            raise NodeError(f"quaternion_xyzw has norm {norm:g}, must be 1")
        a, b, c, w = (value / norm for value in turn)
        self.output_pose.set(FramedPose(start.frame, start.pose @ Pose((x, y, z), (w, a, b, c))))
        return SUCCESS


class TransformPose(OffsetPose):
    """Output a pose that is moved along its own axes, and turned about them; another name of OffsetPose."""


class SaveWaypoint(CellNode):
    """Save the joints where the arm is under a name, in a file below the working folder."""

    traits = Traits(instant=True)

    waypoint_name = InputPort(str, "its name")
    file = InputPort(str, "JSON file with all waypoints", default=WAYPOINTS)

    def update(self) -> Status:
        path, files, journal = self.file.get(), self.tools.files, self.tools.journal
        before = files.read(path, journal)
        known = {} if before is None else entries_in(before, path)
        angles = [round(math.degrees(angle), 4) for angle in self.now.observation.arm.positions_rad]
        files.write(path, text_of({**known, self.waypoint_name.get(): angles}), journal)
        self.feedback_message = f"saved {self.waypoint_name.get()} in {path}"
        return SUCCESS


class RetrieveWaypoint(CellNode):
    """Output the joints that SaveWaypoint saved under a name."""

    traits = Traits(instant=True)

    waypoint_name = InputPort(str, "its name")
    file = InputPort(str, "JSON file with all waypoints", default=WAYPOINTS)
    waypoint_joint_state = OutputPort(list[float], "angles in [deg], as MoveToJoints takes them")

    def update(self) -> Status:
        path, name = self.file.get(), self.waypoint_name.get()
        text = self.tools.files.read(path, self.tools.journal)
        known = {} if text is None else entries_in(text, path)
        if name not in known:
            raise NodeError(f"{path} has no waypoint '{name}'; it has: {', '.join(known) or 'none'}")
        self.waypoint_joint_state.set(_numbers(name, known[name], self.tools.motion.kinematics.count))
        return SUCCESS


class PlanToPose(CellNode):
    """Plan how the tool gets to a pose on a collision-free path; nothing moves."""

    pose = InputPort(FramedPose, "where the tool (TCP) goes")
    solution = OutputPort(PlannedMove, "the plan")

    def update(self) -> Status:
        from bracket_cell.skills import move_to

        seen, memory, pose = self.now.observation, self.memory, self.pose.get()
        if not seen.arm.stands:
            self.feedback_message = "waits until the arm stands"
            return RUNNING
        target, held = world_from_tool(self.services, pose), memory.held_part or None
        move = move_to.MoveToPose(self.tools.motion, str(pose), memory.standing, held, world_from_tool=target)
        plan = move.plan(seen)
        if isinstance(plan, str):
            raise NodeError(plan)
        self.solution.set(PlannedMove(plan, str(pose)))
        self.feedback_message = f"{plan.duration_s:.1f} s to {pose}"
        return SUCCESS


class ExecuteTrajectory(SkillNode):
    """Move as PlanToPose planned; fails where that is not the way any more, so that no other one is taken unseen."""

    traits = Traits(claims=("arm",))

    solution = InputPort(PlannedMove, "the plan")

    def make_skill(self) -> Skill:
        from bracket_cell.skills import move_to

        plan = self.solution.get()
        return move_to.FollowPlan(self.tools.motion, plan.to, *self.surroundings, approved=plan.trajectory)


class _Approval(Asks):
    """Asks whether to go on; fails where somebody says no, or nobody answers in time."""

    abstract = True

    wait_s = InputPort(float, "longest wait in [s]", default=60.0)

    def proposal(self) -> str:
        """What is to be approved, in words."""
        raise NotImplementedError

    def initialise(self) -> None:
        text = self.proposal()
        self._asked_s = self.now.observation.time_s
        answers = (Answer(APPROVE, "go"), Answer(REJECT, "do not go"))
        self._question = self.services.ask("choice", text, todo="Look where the tool will go.", answers=answers)
        self.now.show(help_request=text)
        self.tools.journal.note("help", text=text, answers=[APPROVE, REJECT])
        self.feedback_message = f"asks: {text}"

    def update(self) -> Status:
        answer = self.answered()
        if answer is not None:
            self.feedback_message = f"answered: {answer}"
            return SUCCESS if answer == APPROVE else FAILURE
        return FAILURE if self.late(self.wait_s.get()) else RUNNING


class WaitForUserTrajectoryApproval(_Approval):
    """Ask a person whether a planned motion may begin: where it goes, how far, how fast and how low."""

    solution = InputPort(PlannedMove, "the plan")

    def proposal(self) -> str:
        plan = self.solution.get()
        kinematics, steps = self.tools.motion.kinematics, plan.trajectory
        times = np.linspace(0.0, steps.duration_s, 50)
        places = np.array([kinematics.position_m(joints) for joints in steps.along(times)])
        ways = np.linalg.norm(np.diff(places, axis=0), axis=1)
        speed = ways.max() / max(times[1], 1e-9)
        far = f"{ways.sum():.2f} m in {steps.duration_s:.1f} s, at most {speed:.2f} m/s"
        return f"May the tool move to {plan.to}? {far}, lowest at {places[:, 2].min():.2f} m"


class ApprovePath(_Approval):
    """Ask a person whether the tool may go through a list of poses."""

    path = InputPort(list[FramedPose], "the poses, in order")

    def proposal(self) -> str:
        poses = self.path.get()
        if not poses:
            raise NodeError("the path has no pose")
        places = [world_pose(self.services, pose).position_m for pose in poses]
        way = sum(math.dist(one, other) for one, other in pairwise(places))
        low = min(z for _, _, z in places)
        return f"May the tool go from {poses[0]} to {poses[-1]}? {len(poses)} poses, {way:.2f} m, lowest at {low:.2f} m"


def _numbers(name: str, values: object, count: int) -> list[float]:
    """So many numbers."""
    numbers = values if isinstance(values, list | tuple) else ()
    if len(numbers) != count or not all(
        isinstance(number, int | float) and math.isfinite(number) for number in numbers
    ):
        raise NodeError(f"{name} is {values!r}, not {count} numbers")
    return [float(number) for number in numbers]
