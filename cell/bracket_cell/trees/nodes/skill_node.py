"""Nodes that drive a skill: start it, poll it every tick, halt it when the tree turns elsewhere."""

from __future__ import annotations

from bracket_cell.trees.nodes.services import CellNode
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.skill import Progress, Skill, SkillStatus
from btxml.engine.status import Status
from btxml.engine.traits import Traits

HELD = "a part in the gripper"  # what nodes bring about, ask about or need
STATUSES = {
    SkillStatus.RUNNING: Status.RUNNING,
    SkillStatus.SUCCESS: Status.SUCCESS,
    SkillStatus.FAILURE: Status.FAILURE,
}


class SkillNode(CellNode):
    """Base of the nodes that move arm or gripper; a subclass says which skill it runs."""

    abstract = True
    traits = Traits(claims=("arm", "gripper"))

    _skill: Skill | None = None

    @property
    def surroundings(self) -> tuple[tuple[PartDetection, ...], str | None]:
        """Parts that the arm keeps clear of, and the type of the one that it may carry."""
        memory = self.memory
        return memory.standing, memory.held_part or None

    def make_skill(self) -> Skill:
        """The skill for the present values of the ports."""
        raise NotImplementedError

    def initialise(self) -> None:
        self._skill = self.make_skill()

    def update(self) -> Status:
        progress = self.poll()
        if progress.status is SkillStatus.FAILURE:
            self.memory.failed(progress.reason)
        return STATUSES[progress.status]

    def poll(self) -> Progress:
        """Let the skill carry on, and tell what it does."""
        assert self._skill is not None, "initialise comes first"
        progress = self._skill.poll(self.now.observation, self.now.command)
        if progress.reason != self.feedback_message:
            self.feedback_message = progress.reason
            self.now.show(message=progress.reason)
            self.tools.journal.note(
                "skill", node=type(self).__name__, status=progress.status.value, reason=progress.reason
            )
        return progress

    def terminate(self, new_status: Status) -> None:
        if new_status is Status.INVALID and self._skill is not None:
            self._skill.halt(self.now.command)
            self.tools.journal.note("skill", node=type(self).__name__, status="halted", reason="halted")
        self._skill = None
