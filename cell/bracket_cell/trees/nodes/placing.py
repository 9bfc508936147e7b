"""Putting a part into its hole, seeing that it is there, and noting it (Alg. 1 lines 18-19)."""

from __future__ import annotations

from dataclasses import replace

from bracket_cell.trees.nodes.services import CellNode
from bracket_cell.trees.nodes.skill_node import SkillNode
from bracket_cell.trees.vocabulary import Hole, Part, ShownAs
from bracket_ground.files.words.message import Message
from bracket_ground.interfaces.memory import more, without
from bracket_ground.interfaces.observation import Observation
from bracket_ground.interfaces.planning import AssemblyState
from bracket_ground.interfaces.skill import Skill
from btxml.engine.ports import InOutPort, InputPort, OutputPort
from btxml.engine.status import Status

TRIED_S = 1.0  # a placement that fails sooner found no way, and touched nothing


class PlacePart(SkillNode):
    """Put the part in the gripper into its hole, and let it go there (Alg. 1 line 18)."""

    traits = replace(SkillNode.traits, needs_guard=True, shown_as=ShownAs.PLACES)

    part = InputPort(Part, "type of the part in the gripper")
    position = InputPort(Hole, "hole to put it into")

    _begun_s = 0.0

    def make_skill(self) -> Skill:
        from bracket_cell.skills.pick_and_place import Place

        services = self.services
        self._begun_s = services.now.observation.time_s
        return Place(services.tools.motion, self.position.get(), self.part.get(), services.memory.standing)

    def update(self) -> Status:
        status, services = super().update(), self.services
        where = _where(self.part.get(), self.position.get())
        if status is Status.SUCCESS:
            services.memory.unplaced = without(services.memory.unplaced, where)
            services.memory.let_go = {**services.memory.let_go, self.position.get(): self.part.get()}
        elif status is Status.FAILURE and self._tried(services.now.observation):
            services.memory.unplaced = more(services.memory.unplaced, where)
        return status

    def _tried(self, seen: Observation) -> bool:
        """Whether the part that is still held met something."""
        return seen.gripper.holding and seen.time_s - self._begun_s >= TRIED_S


class PlacedInVain(CellNode):
    """Parts of a type did not go into a hole several times in a row; then the count starts again, if it is told so.

    So it is where the hole is seen to be empty, and is not, or where a part is broken.
    """

    node_type = "Condition"

    part = InputPort(Part, "type of the part in the gripper")
    position = InputPort(Hole, "hole it should go into")
    tries = InputPort(int, "how many times", default=3)
    forget = InputPort(bool, "the count starts again", default=True)

    def update(self) -> Status:
        part, position = self.part.get(), self.position.get()
        memory, where = self.memory, _where(part, position)
        if self.compare(memory.unplaced.get(where, 0), "<", self.tries):
            return Status.FAILURE
        self.feedback_message = Message(
            "the {part} does not go into {position}", part=self.tools.product.title(part), position=position
        )
        if self.forget.get():
            memory.unplaced = without(memory.unplaced, where)
            memory.failed(self.feedback_message)
        return Status.SUCCESS


class AwaitLetGo(CellNode):
    """Wait until a part was let go in a hole, and is not yet seen there."""

    part = OutputPort(Part, "type of that part")
    position = OutputPort(Hole, "hole it was put into")

    def update(self) -> Status:
        for position, part in self.memory.let_go.items():
            self.part.set(Part(part))
            self.position.set(Hole(position))
            self.feedback_message = Message("let go of {part} at {position}", part=part, position=position)
            return Status.SUCCESS
        self.feedback_message = ""
        return Status.RUNNING


class VerifyPlacement(CellNode):
    """Check that the hole now holds the part, upright, as soon as the view of it is free.

    Where it does not, the part may stick to a finger: FeelFingers knows then that it is to feel.
    """

    part = InputPort(Part, "type of the placed part")
    position = InputPort(Hole, "hole it was put into")
    timeout_s = InputPort(float, "how long it may look otherwise in a clear view", default=2.0, least=0)
    hidden_s = InputPort(float, "longest wait for a clear view", default=10.0, least=0)

    _begun_s = 0.0
    _seen_since_s: float | None = None

    def initialise(self) -> None:
        self._begun_s, self._seen_since_s = self.now.observation.time_s, None

    def update(self) -> Status:
        part, position, now_s = self.part.get(), self.position.get(), self.now.observation.time_s
        view = self.now.observation.bench
        hole = view.holes.get(position) if view else None
        if hole is None and not self.tools.guard.wants_holes:
            self.feedback_message = Message("nothing reads {position}", position=position)
            return Status.SUCCESS
        clear = hole is not None and hole.seen_s > self._begun_s
        if clear and hole is not None and hole.part == part and hole.upright:
            self.feedback_message = Message("{part} is at {position}", part=part, position=position)
            return Status.SUCCESS
        seen = "nothing" if hole is None else f"{hole.part or 'nothing'}{'' if hole.upright else ', tilted'}"
        self.feedback_message = Message("sees {seen} at {position}", seen=seen, position=position)
        self.what_if = f"if {part} were seen upright at {position}"
        if clear and self._seen_since_s is None:
            self._seen_since_s = now_s
        late = self._seen_since_s is not None and self.compare(now_s - self._seen_since_s, ">", self.timeout_s)
        if not late and self.compare(now_s - self._begun_s, "<=", self.hidden_s):
            return Status.RUNNING
        self.memory.let_go = {at: part for at, part in self.memory.let_go.items() if at != position}
        self.memory.fingers_doubted = True
        return Status.FAILURE


class RecordPlacement(CellNode):
    """Set the edge of the part that the robot placed (Alg. 1 line 19)."""

    state = InOutPort(AssemblyState, "what is placed so far")
    part = InputPort(Part, "type of the placed part")
    position = InputPort(Hole, "hole it was put into")

    def update(self) -> Status:
        part, position = self.part.get(), self.position.get()
        state = self.state.get()
        by_robot = {**state.by_robot, position: part}
        self.memory.let_go = {at: part for at, part in self.memory.let_go.items() if at != position}
        self.state.set(replace(state.with_placement(part, position), by_robot=by_robot))
        self.now.show(message=Message("placed {part} at {position}", part=part, position=position))
        self.tools.journal.note("belief", edge=[part, position], source="robot")
        return Status.SUCCESS


def _where(part: str, position: str) -> str:
    return f"{part} at {position}"
