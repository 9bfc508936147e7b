"""Nodes that drive a skill: start it, poll it every tick, halt it when the tree turns elsewhere."""

from __future__ import annotations

from typing import ClassVar

from py_trees.common import Status

from cell.interfaces.skill import Progress, Skill, SkillStatus
from trees.nodes.services import CellNode

_STATUS = {
    SkillStatus.RUNNING: Status.RUNNING,
    SkillStatus.SUCCESS: Status.SUCCESS,
    SkillStatus.FAILURE: Status.FAILURE,
}


class SkillNode(CellNode):
    """Base of the nodes that move arm or gripper; a subclass says which skill it runs."""

    abstract = True
    claims: ClassVar[tuple[str, ...]] = ("arm", "gripper")

    _skill: Skill | None = None

    def make_skill(self) -> Skill:
        """The skill for the present values of the ports."""
        raise NotImplementedError

    def initialise(self) -> None:
        self._skill = self.make_skill()

    def update(self) -> Status:
        progress = self.poll()
        if progress.status is SkillStatus.FAILURE:
            self.services.failed(progress.reason)
        return _STATUS[progress.status]

    def poll(self) -> Progress:
        """Let the skill carry on, and tell what it does."""
        assert self._skill is not None, "initialise comes first"
        progress = self._skill.poll(self.services.observation, self.services.command)
        if progress.reason != self.feedback_message:
            self.feedback_message = progress.reason
            self.services.show(message=progress.reason)
            self.services.journal.note(
                "skill", node=type(self).__name__, status=progress.status.value, reason=progress.reason
            )
        return progress

    def terminate(self, new_status: Status) -> None:
        if new_status is Status.INVALID and self._skill is not None:
            self._skill.halt(self.services.command)
            self.services.journal.note("skill", node=type(self).__name__, status="halted", reason="halted")
        self._skill = None
