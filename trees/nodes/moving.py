"""Leaves that move arm and gripper; the skills do the work (Alg. 1 line 12, Alg. 2 lines 5 and 9)."""

from __future__ import annotations

from enum import Enum

from py_trees.common import Status

from cell.interfaces.perception import PartsView
from cell.interfaces.skill import Skill
from skills.move_aside import MoveAside as MoveAsideSkill
from skills.move_to import MoveTo as MoveToSkill
from skills.pick import Pick
from skills.place import Place
from trees.nodes.clutter import chosen
from trees.nodes.services import CellNode
from trees.nodes.skill_node import SkillNode
from trees.ports import InputPort


class NamedPose(Enum):
    """Arm poses that the bench file names."""

    park = "park"
    look = "look"


class ActivateGripper(CellNode):
    """Activate the gripper, once, and wait until it is ready."""

    timeout_s = InputPort(float, "longest wait for the gripper", default=6.0)

    _asked_s = 0.0

    def initialise(self) -> None:
        self._asked_s = self.services.observation.time_s
        self.services.command.activate_gripper = not self.services.observation.gripper.activated

    def update(self) -> Status:
        if self.services.observation.gripper.activated:
            return Status.SUCCESS
        self.feedback_message = "the gripper opens and closes once"
        late = self.services.observation.time_s - self._asked_s > self.timeout_s.get()
        return Status.FAILURE if late else Status.RUNNING


class GripperIsEmpty(CellNode):
    """Nothing is between the fingers."""

    kind = "Condition"

    def update(self) -> Status:
        return Status.FAILURE if self.services.observation.gripper.holding else Status.SUCCESS


class MoveTo(SkillNode):
    """Move the arm to a named pose."""

    pose = InputPort(NamedPose, "park: out of the overhead view; look: the wrist camera sees the tray")

    def make_skill(self) -> Skill:
        bench = self.services.bench
        pose = self.pose.get()
        joints = bench.arm_look_rad if pose is NamedPose.look else bench.arm_park_rad
        return MoveToSkill(self.services.motion, joints, pose.value)


class PickPart(SkillNode):
    """Grasp a seen part and lift it (Alg. 2 line 5)."""

    parts = InputPort(PartsView, "parts seen in the tray")
    index = InputPort(int, "number of the part among the seen ones")

    def make_skill(self) -> Skill:
        parts = self.parts.get()
        index = chosen(parts, self.index.get())
        return Pick(self.services.motion, parts.detections, index)


class MoveAside(SkillNode):
    """Take a seen part to a free spot of the tray (Alg. 2 line 9: "move b")."""

    parts = InputPort(PartsView, "parts seen in the tray")
    index = InputPort(int, "number of the part among the seen ones")

    def make_skill(self) -> Skill:
        parts = self.parts.get()
        index = chosen(parts, self.index.get())
        return MoveAsideSkill(self.services.motion, parts.detections, index)
