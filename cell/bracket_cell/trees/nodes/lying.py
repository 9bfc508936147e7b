"""Parts that lie: find one, set it upright, or take it as it lies.

The skills are imported by the nodes that make them, so that `cell check` does not wait for kinematics.
"""

from __future__ import annotations

import math
from dataclasses import replace

from bracket_cell.trees.nodes.clutter import lies_on_its_side
from bracket_cell.trees.nodes.services import CellNode
from bracket_cell.trees.nodes.skill_node import HELD, SkillNode
from bracket_cell.trees.vocabulary import Part
from bracket_ground.files.words.message import Message
from bracket_ground.interfaces.memory import more, without
from bracket_ground.interfaces.perception import PartDetection, PartsView
from bracket_ground.interfaces.skill import Skill
from btxml.engine.errors import NodeError
from btxml.engine.ports import InputPort, OutputPort
from btxml.engine.status import Status


class FindLying(CellNode):
    """Choose a part that lies in the tray and whose posture is known: of a type, near another part, or any.

    One that could not be taken, or not be set upright, comes after the others, and after `tries` times not at all. Nor
    does a type of which none is seen to stand, however often one was turned: how these lie is seen wrongly. Nor one on
    which something lies.
    """

    part = InputPort(Part, "only this type; any type if left out", optional=True)
    parts = InputPort(PartsView, "parts seen in the tray")
    near = InputPort(int, "number of a seen part; only what lies near it", optional=True)
    on_others = InputPort(bool, "only what lies on others", default=False)
    within_m = InputPort(float, "how near to it, middle to middle", default=0.15, least=0)
    tries = InputPort(int, "how often one is tried", default=2)
    after = InputPort(int, "only one that was tried in vain so often", default=0)
    turns = InputPort(int, "how often parts of a type are turned of which none is seen to stand then", default=3)
    index = OutputPort(int, "number of the part that lies among the seen ones")

    def update(self) -> Status:
        from bracket_cell.skills.lying import raised

        view, part, near = self.parts.get(), self.part.get_or(""), self.near.get_or(None)
        if near is not None and not 0 <= near < len(view.seen):
            raise NodeError(f"part number {near} is not among the {len(view.seen)} seen parts")
        there = None if near is None else _place(view.seen[near])
        found = []
        for number, detection in enumerate(view.seen):
            away_m = 0.0 if there is None else math.dist(_place(detection), there)
            failed = self.memory.tried_in_vain(detection)
            wanted = (
                detection.lies is not None
                and part in ("", detection.part)
                and self.compare(away_m, "<=", self.within_m, str(number))
            )
            wanted = (
                wanted
                and not view.on_top(number)
                and (not self.on_others.get() or raised(self.tools.motion, detection))
            )
            if wanted and self.after.get() <= failed < self.tries.get() and not self._turned_in_vain(detection):
                found.append((failed, away_m, -detection.confidence, number))
        if not found:
            self.feedback_message = f"no {part or 'part'} lies {'near it' if there else 'there'} that could be taken"
            return Status.FAILURE
        number = min(found)[-1]
        self.index.set(number)
        self.feedback_message = f"{view.seen[number].part} lies there"
        return Status.SUCCESS

    def _turned_in_vain(self, detection: PartDetection) -> bool:
        turned = self.memory.turned.get(detection.part, 0)
        if self.compare(turned, "<", self.turns):
            return False
        title = self.tools.product.title(detection.part)
        self.memory.failed(
            Message("I turned the {title} {turned} times, and still see it lie on its side", title=title, turned=turned)
        )
        return True


class TakesLying(SkillNode):
    """Base of the nodes that take a part that lies."""

    abstract = True

    parts = InputPort(PartsView, "parts seen in the tray")
    index = InputPort(int, "number of the part that lies among the seen ones")

    _target: PartDetection

    def make_skill(self) -> Skill:
        services, parts, index = self.services, self.parts.get(), self.index.get()
        if not 0 <= index < len(parts.seen) or parts.seen[index].lies is None:
            raise NodeError(f"part number {index} is none that is seen to lie, and how")
        self._target = parts.seen[index]
        services.note_pick(self._target, parts.seen[:index] + parts.seen[index + 1 :], lying=True)
        return self.skill()

    def skill(self) -> Skill:
        """What is done with it."""
        raise NotImplementedError

    def update(self) -> Status:
        status = super().update()
        if status is Status.FAILURE:
            self.memory.failed_at(self._target)
        return status


class SetUpright(TakesLying):
    """Take a lying part and stand it on its peg where the tray is free.

    One that lies on its head is laid on another side first: look again, and set it upright from there.
    """

    def skill(self) -> Skill:
        from bracket_cell.skills import lying

        return lying.SetUpright(self.tools.motion, self._target, self.memory.standing)

    def update(self) -> Status:
        status = super().update()
        if status is Status.SUCCESS:  # it lies no more as it lay: nobody need be told
            memory, part = self.memory, self._target.part
            memory.reasons = without(memory.reasons, lies_on_its_side(self.tools.product.title(part)))
            memory.room_for_lying()
            memory.turned = more(memory.turned, part)
        return status


class PickLying(TakesLying):
    """Take a part as it lies and lift it, to put it down elsewhere with `PutDown`; it fits into no hole."""

    traits = replace(TakesLying.traits, gives=(HELD,))

    def skill(self) -> Skill:
        from bracket_cell.skills import lying

        return lying.PickLying(self.tools.motion, self._target, self.memory.standing)


def _place(detection: PartDetection) -> tuple[float, float]:
    x, y, _ = detection.world_from_part.position_m
    return x, y
