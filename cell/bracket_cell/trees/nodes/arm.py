"""Motions of the arm to places that the tree file gives: poses, joints, lines, contact."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np

from bracket_cell.trees.nodes.clutter import part_and_others
from bracket_cell.trees.nodes.poses import (
    TOOL,
    WORLD,
    FramedPose,
    frame_pose,
    near_bracket,
    tool_pose,
    world_from_tool,
)
from bracket_cell.trees.nodes.services import CellNode, Services
from bracket_cell.trees.nodes.skill_node import HELD, STATUSES, SkillNode
from bracket_ground.files.words.message import Message
from bracket_ground.interfaces.command import GripperCommand
from bracket_ground.interfaces.perception import PartsView
from bracket_ground.interfaces.pose import FINGERS_DOWN
from bracket_ground.interfaces.skill import Progress, Skill
from btxml.engine.errors import NodeError
from btxml.engine.node import SUCCESS
from btxml.engine.outside import Asked, Question
from btxml.engine.ports import InputPort, OutputPort
from btxml.engine.status import Status
from btxml.engine.traits import Traits

FEELING_M_S = 0.05  # faster, and what is met is pushed before the arm knows


class MoveToPose(SkillNode):
    """Move the tool to a pose on a collision-free path; without a rotation the fingers point down."""

    traits = Traits(claims=("arm",))

    pose = InputPort(FramedPose, "where the tool (TCP) goes")

    def make_skill(self) -> Skill:
        from bracket_cell.skills import move_to

        services, pose = self.services, self.pose.get()
        target = world_from_tool(services, pose)
        return move_to.MoveToPose(services.tools.motion, str(pose), *self.surroundings, world_from_tool=target)


class RunPolicy(SkillNode):
    """Let a trained policy (ONNX) lead the arm to a seen part, within a zone, by collision-free motions.

    A guard must agree in every tick. What a policy sees stands in `bracket_cell.learned.inference.policy`, by name:
    images are taken when it is asked. The log holds its answers; a replay asks nobody.
    """

    traits = replace(SkillNode.traits, claims=("arm",), needs_guard=True)

    file = InputPort(str, "ONNX file of the policy, relative to the working folder")
    parts = InputPort(PartsView, "parts seen in the tray")
    index = InputPort(int, "number of the part among the seen ones")
    zone_m = InputPort(list[float], "where the tool may go in the world: least and largest x, then y, then z in [m]")
    motions = InputPort(int, "motions that it may make", default=10)
    above_m = InputPort(float, "how far over the part its target is in [m]", default=0.16)

    _question: Question | None = None

    def make_skill(self) -> Skill:
        from bracket_cell.skills.follow_policy import FollowPolicy

        zone, services = self.zone_m.get(), self.services
        if len(zone) != 6 or any(most <= least for least, most in zip(zone[::2], zone[1::2], strict=True)):
            raise NodeError(f"zone_m {zone} is not least;largest x;y;z like 0.3;0.8;-0.6;0.3;0.1;0.6")
        part, others = part_and_others(self.parts.get(), self.index.get())
        x, y, z = self._part_m = part.world_from_part.position_m
        self._target_m, self._noted = (x, y, z + self.above_m.get()), False
        motion, (_, held), motions = services.tools.motion, self.surroundings, self.motions.get()
        box = (zone[0], zone[1], zone[2], zone[3], zone[4], zone[5])
        return FollowPolicy(motion, (part, *others), held, zone=box, steps=motions)

    def poll(self) -> Progress:
        skill: Any = self._skill
        if skill.asks(self.now.observation) and (answer := self._answer()) is not None:
            if not self._noted:
                self.tools.journal.note("message", text=f"policy {self.file.get()}, sha256 {answer['sha256']}")
            self._noted = True
            skill.feed([np.array(row) for row in answer["actions"]])
        return super().poll()

    def _answer(self) -> Any:
        """What the policy answered, see `PolicyDevice.ask`; None as long as it did not.

        Raises:
            NodeError: it has no answer.
        """
        if self._question is None:
            self._question = self._asked()
        answer = self._question.poll()
        if answer is None:
            return None
        self._question = None
        if answer.error:
            raise NodeError(answer.error)
        return json.loads(answer.text)

    def _asked(self) -> Question:
        from bracket_cell.learned.inference.policy import observed

        seen, file, policies = self.now.observation, self.file.get(), self.tools.policies
        sees = observed(seen.arm, seen.gripper, self._part_m, self._target_m)
        fields = {name: sees[name].tolist() for name in ("state", "part", "target")}

        def ask() -> Asked:
            assert policies is not None, "a run has them"
            return policies.ask(file, sees)

        return Question(self, {"policy": file, **fields}, ask)

    def terminate(self, new_status: Status) -> None:
        if self._question is not None:
            self._question.cancel()
            self._question = None
        super().terminate(new_status)


class MoveToJoints(SkillNode):
    """Move the arm to joint angles on a collision-free path."""

    traits = Traits(claims=("arm",))

    joints_deg = InputPort(list[float], "angles of all joints in [deg] from the base to the flange: 0;-90;90;-90;-90;0")

    def make_skill(self) -> Skill:
        from bracket_cell.skills import move_to

        angles = self.joints_deg.get()
        services = self.services
        if len(angles) != (count := services.tools.motion.kinematics.count):
            raise NodeError(f"the arm has {count} joints, not {len(angles)}")
        return move_to.MoveToJoints(services.tools.motion, *self.surroundings, joints_rad=np.radians(angles))


class MoveStraight(SkillNode):
    """Move the tool on a straight line to a pose."""

    traits = Traits(claims=("arm",))

    pose = InputPort(FramedPose, "where the tool (TCP) goes")
    speed_m_s = InputPort(float, "speed of the tool in [m/s]", default=0.1, least=0)

    def make_skill(self) -> Skill:
        from bracket_cell.skills.grasping.straight import StraightMove

        services, pose = self.services, self.pose.get()
        speed, target = _speed(services, self.speed_m_s.get()), world_from_tool(services, pose)
        return StraightMove(services.tools.motion, target, str(pose), speed, *self.surroundings)


class MoveBy(SkillNode):
    """Move the tool on a straight line by a distance from where it is, and turn it."""

    traits = Traits(claims=("arm",))

    by = InputPort(FramedPose, "how far along the axes of a frame, and how much turned: world: 0 0 0.1; 0 0 90")
    speed_m_s = InputPort(float, "speed of the tool in [m/s]", default=0.1, least=0)

    def make_skill(self) -> Skill:
        from bracket_cell.skills.grasping.straight import StraightMoveBy

        services, by = self.services, self.by.get()
        speed, axes = _speed(services, self.speed_m_s.get()), frame_pose(services, by.frame)
        motion, words = services.tools.motion, Message("by {by}", by=by)
        return StraightMoveBy(motion, by.pose, words, speed, *self.surroundings, axes=axes)


class MoveUntilContact(SkillNode):
    """Move the tool on a straight line until it meets something; fails if it meets nothing."""

    traits = Traits(claims=("arm",))

    by = InputPort(FramedPose, "the longest way along the axes of a frame: world: 0 0 -0.05")
    speed_m_s = InputPort(float, f"speed of the tool in [m/s], at most {FEELING_M_S}", default=0.02, least=0)

    def make_skill(self) -> Skill:
        from bracket_cell.skills.grasping import straight

        services, by = self.services, self.by.get()
        speed = self.speed_m_s.get()
        if not 0 < speed <= FEELING_M_S:
            raise NodeError(
                f"speed_m_s is {speed:g}; more than 0 and at most {FEELING_M_S} where contact is looked for"
            )
        return straight.MoveUntilContact(
            services.tools.motion, frame_pose(services, by.frame).rotation @ np.array(by.pose.position_m), speed
        )


class GetToolPose(CellNode):
    """Output where the tool is, to come back there later."""

    traits = Traits(instant=True)

    pose = OutputPort(FramedPose, "where the tool (TCP) is, in the world")

    def update(self) -> Status:
        self.pose.set(FramedPose(WORLD, tool_pose(self.services)))
        self.feedback_message = f"the tool is at {self.pose.entry.value}" if self.pose.entry else ""
        return SUCCESS


class ToolIsAt(CellNode):
    """The tool is at a pose, within a distance and an angle."""

    node_type = "Condition"
    traits = Traits(instant=True)

    pose = InputPort(FramedPose, "where it should be")
    within_m = InputPort(float, "how far off it may be in [m]", default=0.005, least=0)
    within_deg = InputPort(float, "how far turned it may be in [deg]", default=3.0)

    def update(self) -> Status:
        wanted = self.pose.get()
        if wanted.frame == TOOL:
            raise NodeError("the tool is always at a pose of its own frame; give another one")
        off = world_from_tool(self.services, wanted).inverse() @ (tool_pose(self.services) @ FINGERS_DOWN)
        distance_m = math.dist(off.position_m, (0.0, 0.0, 0.0))
        angle_deg = math.degrees(2 * math.acos(min(1.0, abs(off.quaternion_wxyz[0]))))
        self.feedback_message = f"{distance_m * 1000:.1f} mm and {angle_deg:.1f} degrees off"
        near = self.compare(distance_m, "<=", self.within_m) and self.compare(angle_deg, "<=", self.within_deg)
        return SUCCESS if near else Status.FAILURE


def _speed(services: Services, speed_m_s: float) -> float:
    most = services.tools.motion.settings.line_speed_m_s
    if not 0 < speed_m_s <= most:
        raise NodeError(f"speed_m_s is {speed_m_s:g}; more than 0 and at most {most:g}, the configuration's limit")
    return speed_m_s


class OpenGripper(SkillNode):
    """Open the fingers and let go of a held part, but never over the bracket: PlacePart does that."""

    traits = Traits(claims=("gripper",))

    opening_m = InputPort(
        float, "distance between the fingers in [m]; their stroke where it is left out", optional=True
    )
    speed_m_s = InputPort(float, "speed of the fingers in [m/s]", default=0.1, least=0)

    def make_skill(self) -> Skill:
        from bracket_cell.skills.grasping.phases import MoveFingers

        services = self.services
        does = services.tools.motion.settings.gripper.does
        opening = _within("opening_m", self.opening_m.get_or(does.stroke_m), (0.0, does.stroke_m))
        speed = _within("speed_m_s", self.speed_m_s.get(), does.speed_m_s)
        bench, product = services.tools.bench, services.tools.product
        if services.now.observation.gripper.holding and near_bracket(bench, product, tool_pose(services)):
            raise NodeError("a part would be let go over the bracket; PlacePart does that, behind its guard")
        goal = GripperCommand(opening, speed)
        return MoveFingers(
            services.tools.motion.settings,
            goal,
            Message("opening the fingers to {opening} mm", opening=f"{opening * 1000:.0f}"),
        )


class CloseGripper(SkillNode):
    """Close the fingers; fails if they close on nothing, unless that is expected."""

    traits = Traits(claims=("gripper",), gives=(HELD,))

    force_n = InputPort(float, "force of the fingers in [N]", default=60.0, least=0)
    speed_m_s = InputPort(float, "speed of the fingers in [m/s]", default=0.1, least=0)
    on_something = InputPort(bool, "fail if nothing is between the fingers", default=True)

    def make_skill(self) -> Skill:
        from bracket_cell.skills.grasping.phases import MoveFingers

        does = self.tools.motion.settings.gripper.does
        force = _within("force_n", self.force_n.get(), does.force_n)
        goal = GripperCommand(0.0, _within("speed_m_s", self.speed_m_s.get(), does.speed_m_s), force)
        settings, must_hold = self.tools.motion.settings, self.on_something.get()
        return MoveFingers(
            settings, goal, Message("closing the fingers with {force} N", force=f"{force:.0f}"), must_hold=must_hold
        )


class FeelFingers(SkillNode):
    """Close the fingers where it is in doubt that nothing sticks to one; fails if something is between them.

    It is in doubt once what was let go in a hole was not seen there.
    """

    traits = Traits(claims=("gripper",), gives=(HELD,))

    always = InputPort(bool, "where it is not in doubt, too: no camera sees what was let go", default=False)

    _feels = False

    def make_skill(self) -> Skill:
        from bracket_cell.skills.grasping.phases import MoveFingers

        settings = self.tools.motion.settings
        goal = GripperCommand(0.0, settings.gripper_speed_m_s, settings.gripper.does.force_n[0])
        return MoveFingers(settings, goal, "feeling whether a part sticks to a finger")

    def initialise(self) -> None:
        self._feels = self.memory.fingers_doubted or self.always.get()
        if self._feels:
            super().initialise()

    def update(self) -> Status:
        if not self._feels:
            return SUCCESS
        memory = self.memory
        status = STATUSES[self.poll().status]
        if status is SUCCESS:
            memory.fingers_doubted = False
        elif status is Status.FAILURE:
            self.feedback_message = Message("a part sticks to a finger")
            memory.failed(self.feedback_message)
        return status


class SetGripForce(SkillNode):
    """Change the grip force on a held part; fails if nothing is held."""

    traits = Traits(claims=("gripper",))

    force_n = InputPort(float, "force of the fingers in [N]", least=0)

    def make_skill(self) -> Skill:
        from bracket_cell.skills.grasping.phases import MoveFingers

        does = self.tools.motion.settings.gripper.does
        force = _within("force_n", self.force_n.get(), does.force_n)
        if not self.now.observation.gripper.holding:
            raise NodeError("the gripper holds nothing")
        goal = GripperCommand(0.0, does.speed_m_s[0], force)
        return MoveFingers(
            self.tools.motion.settings, goal, Message("holding with {force} N", force=f"{force:.0f}"), must_hold=True
        )


def _within(name: str, value: float, limits: tuple[float, float]) -> float:
    low, high = limits
    if not low <= value <= high:
        raise NodeError(f"{name} is {value:g}; the gripper takes {low:g} to {high:g}")
    return value
