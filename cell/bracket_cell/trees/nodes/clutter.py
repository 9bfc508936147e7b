"""Getting at a part in clutter (Alg. 2): look, judge graspability, decode what to move away."""

from __future__ import annotations

import math
from dataclasses import replace

from bracket_cell.trees.nodes.services import CellNode
from bracket_cell.trees.vocabulary import Part
from bracket_ground.files.words.message import Message
from bracket_ground.interfaces.memory import without
from bracket_ground.interfaces.perception import PartDetection, PartsView
from btxml.engine.errors import NodeError
from btxml.engine.ports import InputPort, OutputPort
from btxml.engine.status import Status

LOST_S = 0.4  # a frame that has not come by then is asked for again: cameras lose some


class LookAtTray(CellNode):
    """Take an image with the wrist camera and wait for its detections (Alg. 2 lines 6-7)."""

    parts = OutputPort(PartsView, "parts seen in the tray")
    timeout_s = InputPort(float, "longest wait for the detector", default=3.0, least=0)

    _asked_s = _again_s = 0.0

    def initialise(self) -> None:
        self._asked_s = self._again_s = self.now.observation.time_s
        self.now.command.look = True

    def update(self) -> Status:
        observation = self.now.observation
        view = observation.parts
        if observation.time_s - self._again_s > LOST_S:
            self._again_s = observation.time_s
            self.now.command.look = True
        if view is not None and view.time_s > self._asked_s:
            self.parts.set(view)
            memory = self.memory
            memory.tray_parts, memory.tray_seen_s = view.seen, view.time_s
            memory.turned = without(memory.turned, *(part.part for part in view.detections))
            lying = "".join(f", {part.part} on its side" for part in view.others)
            self.feedback_message = "sees " + (" ".join(part.part for part in view.detections) or "nothing") + lying
            return Status.SUCCESS
        self.feedback_message = "waiting for the detector"
        late = self.compare(observation.time_s - self._asked_s, ">", self.timeout_s)
        return Status.FAILURE if late else Status.RUNNING


class FindPart(CellNode):
    """Choose among the seen parts of the required type the one that is easiest to get at (Alg. 2 line 8).

    One that slipped out of the fingers, or that these could not get at, comes after the others. One on which others lie
    counts, too, whether it stands or not: these can be moved aside.
    """

    part = InputPort(Part, "required type")
    parts = InputPort(PartsView, "parts seen in the tray")
    index = OutputPort(int, "number of the required part among the seen ones")

    def update(self) -> Status:
        part, parts = self.part.get(), self.parts.get()
        standing = len(parts.detections)
        candidates = [i for i, seen in enumerate(parts.seen) if seen.part == part and (i < standing or parts.on_top(i))]
        if not candidates:
            self.feedback_message, self.what_if = f"no {part} in the tray", f"if a {part} were seen in the tray"
            lies = any(seen.part == part for seen in parts.others)
            title = self.tools.product.title(part)
            self.memory.failed(
                lies_on_its_side(title) if lies else Message("there is no {title} in the tray", title=title)
            )
            return Status.FAILURE
        plans = {i: self.services.solve(parts, i) for i in candidates}
        vain = {i: self.memory.tried_in_vain(parts.seen[i]) for i in candidates}
        self.index.set(min(candidates, key=lambda i: (plans[i].needs_help, vain[i], -plans[i].graspable)))
        return Status.SUCCESS


class CheckGraspability(CellNode):
    """Can this part be grasped as it stands, or taken as it lies? (Alg. 2 lines 9 and 14, Eq. 6)

    One on which something lies cannot.
    """

    parts = InputPort(PartsView, "parts seen in the tray")
    index = InputPort(int, "number of the part among the seen ones")
    threshold = InputPort(float, "least probability", default=0.5)

    def update(self) -> Status:
        index, parts = self.index.get(), self.parts.get()
        plan = self.services.solve(parts, index)
        self.tools.journal.note("plan", required=index, graspable=plan.graspable, solution=plan.text)
        names = " ".join(parts.seen[upper].part for upper in parts.on_top(index))
        self.feedback_message = f"{names} on it" if names else f"graspable with probability {plan.graspable:.2f}"
        return Status.SUCCESS if self.compare(plan.graspable, ">=", self.threshold) else Status.FAILURE


class DecodeSolution(CellNode):
    """Decode which part to move away first; fails if only help would do (Alg. 2 lines 11 and 16, Eq. 7).

    Of what lies on the part the topmost goes first.
    """

    parts = InputPort(PartsView, "parts seen in the tray")
    index = InputPort(int, "number of the part that cannot be grasped")
    blocker = OutputPort(int, "number of the part that becomes the required one")

    def update(self) -> Status:
        plan = self.services.solve(self.parts.get(), self.index.get())
        self.feedback_message = plan.text
        if plan.needs_help or not plan.blockers:
            self.memory.failed(self._why(self.parts.get(), self.index.get()))
            return Status.FAILURE
        self.blocker.set(plan.blockers[0])
        return Status.SUCCESS

    def _why(self, parts: PartsView, index: int) -> str:
        title = self.tools.product.title(seen_part(parts, index).part)
        if parts.on_top(index):
            return Message("the {title} cannot be taken: something lies on it, and I do not see how", title=title)
        why = self.services.why_not_graspable(parts, index) or "what stands around it cannot be moved away"
        lying = self._lying_in_the_way(parts, index)
        return Message(
            "the {title} cannot be taken: {lying}", title=title, lying=lying or why.partition(": ")[2] or why
        )

    def _lying_in_the_way(self, parts: PartsView, index: int) -> str:
        """What lies nearest to a part that could be taken if nothing lay there."""
        alone = replace(parts, others=())
        if not parts.others or index >= len(parts.detections) or self.services.why_not_graspable(alone, index):
            return ""
        place = parts.seen[index].world_from_part.position_m[:2]
        near = min(parts.others, key=lambda other: math.dist(other.world_from_part.position_m[:2], place))
        if near.part not in self.tools.product.parts:
            return "something that I do not know lies in the way"
        return Message("the {part} that lies on its side is in the way", part=self.tools.product.title(near.part))


def seen_part(parts: PartsView, index: int) -> PartDetection:
    """A part by its number, standing or lying.

    Raises:
        NodeError: no seen part has this number.
    """
    if not 0 <= index < len(parts.seen):
        raise NodeError(f"part number {index} is not among the {len(parts.seen)} seen parts")
    return parts.seen[index]


def lies_on_its_side(title: str) -> str:
    """Why a part cannot be taken that is seen, but not standing; a detector of boxes alone sees none stand."""
    return Message("the {title} lies on its side, or I cannot tell how it stands", title=title)


def part_and_others(parts: PartsView, index: int) -> tuple[PartDetection, tuple[PartDetection, ...]]:
    """A part that stands, by its number, and all others, standing or lying.

    Raises:
        NodeError: no seen part has this number.
    """
    seen, standing = parts.seen, len(parts.detections)
    if not 0 <= index < standing:
        raise NodeError(f"part number {index} is not among the {standing} seen parts")
    return seen[index], seen[:index] + seen[index + 1 :]
