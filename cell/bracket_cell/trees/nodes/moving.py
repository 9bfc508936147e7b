"""Leaves that move arm and gripper; the skills do the work (Alg. 1 line 18, Alg. 2 line 18).

A skill is imported by the node that makes it, so that `cell check` does not wait for kinematics.
"""

from __future__ import annotations

from dataclasses import replace
from enum import Enum

from bracket_cell.trees.nodes.clutter import part_and_others, seen_part
from bracket_cell.trees.nodes.services import CellNode
from bracket_cell.trees.nodes.skill_node import HELD, SkillNode
from bracket_cell.trees.vocabulary import ShownAs
from bracket_ground.interfaces.memory import NEVER_S, more
from bracket_ground.interfaces.perception import PartDetection, PartsView
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.skill import Skill
from btxml.engine.errors import NodeError
from btxml.engine.ports import InputPort
from btxml.engine.status import Status
from btxml.engine.traits import Traits

DOWN_RAD = 0.1  # a tool that leans more than this holds no part that stood


class NamedPose(Enum):
    """Arm poses that the bench file names."""

    park = "park"
    look = "look"


class ActivateGripper(CellNode):
    """Activate the gripper once, and wait until it is ready."""

    traits = Traits(claims=("gripper",), asked_again=True)

    timeout_s = InputPort(float, "longest wait for the gripper", default=6.0, least=0)

    _asked_s: float | None = None

    def initialise(self) -> None:
        self._asked_s = None

    def update(self) -> Status:
        seen = self.now.observation
        if seen.gripper.activated:
            return Status.SUCCESS
        self.feedback_message = "the gripper opens and closes once"
        if self._asked_s is None:
            if seen.speed_scale == 0:
                return Status.RUNNING
            self._asked_s = seen.worked_s
            self.now.command.activate_gripper = True
        late = self.compare(seen.worked_s - self._asked_s, ">", self.timeout_s)
        return Status.FAILURE if late else Status.RUNNING


class GripperIsEmpty(CellNode):
    """Nothing is between the fingers, so no part can be put into a wrong hole."""

    node_type = "Condition"
    traits = Traits(guards=True, instant=True, gives=(HELD,))
    what_if = "if nothing were felt between the fingers"

    def update(self) -> Status:
        return Status.FAILURE if self.now.observation.gripper.holding else Status.SUCCESS


class ArmStands(CellNode):
    """The arm does not move."""

    node_type = "Condition"
    traits = Traits(instant=True)
    what_if = "if the arm stood"

    def update(self) -> Status:
        arm = self.now.observation.arm
        return Status.SUCCESS if arm.stands and not arm.moving else Status.FAILURE


class IdentifyHeldPart(CellNode):
    """Tell by the distance of the fingers which part is between them, unless this run picked it."""

    traits = Traits(instant=True, gives=(HELD,))

    def update(self) -> Status:
        from bracket_cell.skills.motion.grasp_pose import held_type

        services, memory, motion = self.services, self.memory, self.tools.motion
        taken_here = memory.held_part and (motion.hold is not None or motion.lying is not None)
        if not taken_here and services.tool_tilt_rad() > DOWN_RAD:
            self.feedback_message = "the tool leans, so that it is not known how it holds the part"
            memory.failed("I do not know how I hold it")
            return Status.FAILURE
        if not memory.held_part:
            opening_m = services.now.observation.gripper.opening_m
            memory.held_part = held_type(services.tools.product, opening_m, motion.settings) or ""
        if not memory.held_part:
            self.feedback_message = "something is in the gripper, and its width does not say what"
            memory.failed("I do not know what I hold")
            return Status.FAILURE
        self.feedback_message = f"holds {memory.held_part}"
        return Status.SUCCESS


class MoveTo(SkillNode):
    """Move the arm to a named pose."""

    pose = InputPort(NamedPose, "park: away from bracket and person; look: the wrist camera sees the tray")

    def make_skill(self) -> Skill:
        from bracket_cell.skills import move_to

        services = self.services
        return move_to.MoveTo(services.tools.motion, self.pose.get().value, *self.surroundings)


class PickPart(SkillNode):
    """Grasp a seen part and lift it (Alg. 2 line 18)."""

    traits = replace(SkillNode.traits, gives=(HELD,))

    parts = InputPort(PartsView, "parts seen in the tray")
    index = InputPort(int, "number of the part among the seen ones")
    lifts = InputPort(bool, "lift it; else the next free way begins with that, without a stop", default=True)

    def make_skill(self) -> Skill:
        from bracket_cell.skills.pick_and_place import Pick

        services, parts = self.services, self.parts.get()
        part, others = part_and_others(parts, self.index.get())
        services.note_pick(part, others)
        self._target, self._seen_s = part, parts.time_s  # when the tray was seen is known again once the part is held
        return Pick(services.tools.motion, part, services.memory.standing, lifts=self.lifts.get())

    def update(self) -> Status:
        status = super().update()
        if status is Status.SUCCESS:
            self.memory.tray_seen_s = self._seen_s
        elif status is Status.FAILURE:
            self.memory.failed_at(self._target)
        return status


class MoveAside(SkillNode):
    """Take a seen part to a free spot of the tray, as it stands or as it lies (Alg. 2 line 18: "move b")."""

    parts = InputPort(PartsView, "parts seen in the tray")
    index = InputPort(int, "number of the part among the seen ones")

    def make_skill(self) -> Skill:
        from bracket_cell.skills import lying, move_aside

        parts, index = self.parts.get(), self.index.get()
        part = seen_part(parts, index)
        if part.lies is None and not part.upright:
            raise NodeError(f"part number {index} does not stand, and it is not clear how it lies")
        self.services.note_pick(part, parts.seen[:index] + parts.seen[index + 1 :], lying=not part.upright)
        self._target = part
        skill = move_aside.MoveAside if part.upright else lying.LayAside
        return skill(self.tools.motion, part, self.memory.standing)

    def update(self) -> Status:
        status = super().update()
        if status is Status.FAILURE and not self._target.upright:
            self.memory.failed_at(self._target)
        if status is Status.SUCCESS:
            self.memory.room_for_lying()
            self._count_turn()
        return status

    def _count_turn(self) -> None:
        """One that lay on the floor was laid elsewhere to be set upright there: that is not done for ever."""
        from bracket_cell.skills.lying import raised

        if not self._target.upright and not raised(self.tools.motion, self._target):
            self.memory.turned = more(self.memory.turned, self._target.part)


class ReturnToTray(SkillNode):
    """Put the part in the gripper back into the tray; a part that was lying is set upright if possible.

    One that did not go into its hole is taken after the others from then on.
    """

    traits = replace(SkillNode.traits, needs=(HELD,), shown_as=ShownAs.PUTS_BACK)

    def make_skill(self) -> Skill:
        from bracket_cell.skills.put_down import PutBack

        if not self.memory.held_part:
            raise NodeError("nothing was picked yet, so the part in the gripper has no known type")
        self.memory.tray_seen_s = NEVER_S
        return PutBack(self.tools.motion, self.memory.held_part, self.memory.standing)

    def update(self) -> Status:
        status, memory = super().update(), self.memory
        if status is Status.SUCCESS and any(where.startswith(f"{memory.held_part} at ") for where in memory.unplaced):
            x, y = self.services.tool_on_bench_m()
            memory.failed_at(PartDetection(memory.held_part, 1.0, Pose((x, y, 0.0)), (0.0, 0.0, 0.0), (0, 0, 0, 0)))
        return status
