"""Leaves that give a part to a hand, take one from a hand, and hold one while a hand fastens it.

A skill is imported by the node that makes it, so that `cell check` does not wait for kinematics.
"""

from __future__ import annotations

from dataclasses import replace

from bracket_cell.trees.nodes.ahead import remaining
from bracket_cell.trees.nodes.poses import FramedPose, near_bracket, world_from_tool, world_pose
from bracket_cell.trees.nodes.services import CellNode
from bracket_cell.trees.nodes.skill_node import HELD, SkillNode
from bracket_cell.trees.vocabulary import Hole, Part
from bracket_ground.files.words.message import Message
from bracket_ground.interfaces.memory import NEVER_S
from bracket_ground.interfaces.planning import AssemblyState
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.skill import Skill
from btxml.engine.errors import NodeError
from btxml.engine.ports import InputPort
from btxml.engine.status import Status
from btxml.engine.traits import Traits

LEAST_PULL_N = 5.0  # less is what joints and cables do by themselves


class PartIsNeeded(CellNode):
    """Some product takes one more part of a type, beside those that the holes of the bracket show now."""

    node_type = "Condition"
    traits = Traits(instant=True)

    part = InputPort(Part, "type of the part")

    def update(self) -> Status:
        bench, part = self.now.observation.bench, self.part.get()
        if bench is None:
            self.feedback_message = "the bracket is not seen"
            return Status.FAILURE
        placed = {hole: view.part for hole, view in bench.holes.items() if view.part is not None}
        if remaining(self.services, AssemblyState(placed))[part] <= 0:
            self.feedback_message = Message("no {part} is needed any more", part=part)
            return Status.FAILURE
        return Status.SUCCESS


class HandOver(SkillNode):
    """Hold the part in the gripper out, and let go of it once a hand that is seen at it pulls.

    Fails, with the part in the fingers, where nobody pulls in time, where a force is no pull, or where the arm does not
    tell forces. A pull without a hand at the part opens nothing.
    """

    traits = replace(SkillNode.traits, needs=(HELD,))

    part = InputPort(Part, "type of the part in the gripper")
    pose = InputPort(FramedPose, "where the tool (TCP) holds it out, within the person's reach")
    pull_n = InputPort(float, f"force that is a pull, at least {LEAST_PULL_N:g}", default=8.0, least=0)
    limit_n = InputPort(float, "a greater force is no pull: the fingers keep the part", default=60.0, least=0)
    wait_s = InputPort(float, "how long somebody may take to come and pull", default=20.0, least=0)

    def make_skill(self) -> Skill:
        from bracket_cell.skills import hand_over

        pull_n, limit_n = self.pull_n.get(), self.limit_n.get()
        if not LEAST_PULL_N <= pull_n < limit_n:
            raise NodeError(f"pull_n {pull_n:g} must be at least {LEAST_PULL_N:g} and less than limit_n {limit_n:g}")
        motion, pose, standing = self.tools.motion, _held_out(self), self.memory.standing
        limits = {"pull_n": pull_n, "limit_n": limit_n, "wait_s": self.wait_s.get()}
        return hand_over.HandOver(motion, self.part.get(), pose, standing, **limits)


class TakeFromHand(SkillNode):
    """Hold the open fingers out, and close them gently on the part that a hand puts between them.

    They open again around what is not as wide as the part, and where a hand is seen between them. Fails where nobody
    gives it in time.
    """

    traits = replace(SkillNode.traits, gives=(HELD,))

    part = InputPort(Part, "type of the part that is given")
    pose = InputPort(FramedPose, "where the tool (TCP) takes it, within the person's reach")
    wait_s = InputPort(float, "how long somebody may take to bring it", default=20.0, least=0)

    def make_skill(self) -> Skill:
        from bracket_cell.skills import hand_over

        motion, pose, standing = self.tools.motion, _held_out(self), self.memory.standing
        return hand_over.TakeFromHand(motion, self.part.get(), pose, standing, wait_s=self.wait_s.get())

    def update(self) -> Status:
        status, memory = super().update(), self.memory
        if status is Status.SUCCESS:
            memory.held_part, memory.held_lying, memory.tray_seen_s = self.part.get(), False, NEVER_S
        return status


class HoldForPerson(SkillNode):
    """Put the part in the gripper into its hole and hold it there until it is fastened, then let go.

    It is fastened once a hand was seen to screw there and has left, or a tool has reported. Fails where nobody fastens
    it in time; then it was let go, too.
    """

    traits = replace(SkillNode.traits, needs_guard=True, needs=(HELD,))

    part = InputPort(Part, "type of the part in the gripper")
    position = InputPort(Hole, "hole to put it into")
    wait_s = InputPort(float, "how long somebody may take to fasten it", default=60.0, least=0)

    def make_skill(self) -> Skill:
        from bracket_cell.skills import hand_over

        motion, standing = self.tools.motion, self.memory.standing
        return hand_over.HoldForPerson(motion, self.position.get(), self.part.get(), standing, wait_s=self.wait_s.get())

    def update(self) -> Status:
        from bracket_cell.skills import hand_over

        status, memory = super().update(), self.memory
        at, skill = self.position.get(), self._skill
        holds = isinstance(skill, hand_over.HoldForPerson) and skill.holds
        self.services.held_at = at if status is Status.RUNNING and holds else ""
        if status is not Status.RUNNING and not self.now.observation.gripper.holding:
            memory.let_go = {**memory.let_go, at: self.part.get()}
        return status

    def terminate(self, new_status: Status) -> None:
        self.services.held_at = ""
        super().terminate(new_status)


class HeldForPerson(CellNode):
    """The gripper holds its part in a hole for somebody who fastens it: their hand is welcome there."""

    node_type = "Condition"
    traits = Traits(guards=True, instant=True)

    def update(self) -> Status:
        return Status.SUCCESS if self.services.held_at else Status.FAILURE


def _held_out(node: HandOver | TakeFromHand) -> Pose:
    """Where the tool goes; not over the bracket, where what is let go may fall into a hole."""
    pose, tools = node.pose.get(), node.services.tools
    if near_bracket(tools.bench, tools.product, world_pose(node.services, pose)):
        raise NodeError(f"{pose} is over the bracket, where a part that falls may go into a hole")
    return world_from_tool(node.services, pose)
