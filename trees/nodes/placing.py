"""Putting a part into its hole, seeing that it is there, and noting it (Alg. 1 lines 18-19)."""

from __future__ import annotations

from dataclasses import replace

from cell.interfaces.memory import more, without
from cell.interfaces.planning import AssemblyState
from cell.interfaces.skill import Skill
from trees.engine.ports import InOutPort, InputPort
from trees.engine.status import Status
from trees.engine.vocabulary import Hole, Part
from trees.nodes.services import CellNode
from trees.nodes.skill_node import SkillNode

TRIED_S = 1.0  # a placement that fails sooner found no way, and touched nothing


class PlacePart(SkillNode):
    """Put the part in the gripper into its hole (Alg. 1 line 18)."""

    traits = replace(SkillNode.traits, needs_guard=True)

    part = InputPort(Part, "type of the part in the gripper")
    position = InputPort(Hole, "hole to put it into")

    _begun_s = 0.0

    def make_skill(self) -> Skill:
        from skills.pick_and_place import Place

        services = self.services
        self._begun_s = services.now.observation.time_s
        return Place(services.tools.motion, self.position.get(), self.part.get(), services.memory.standing)

    def update(self) -> Status:
        status, services = super().update(), self.services
        where = _where(self.part.get(), self.position.get())
        if status is Status.SUCCESS:
            services.memory.unplaced = without(services.memory.unplaced, where)
        elif status is Status.FAILURE and services.now.observation.time_s - self._begun_s >= TRIED_S:
            services.memory.unplaced = more(services.memory.unplaced, where)
        return status


class PlacedInVain(CellNode):
    """The part did not go into its hole several times in a row; then the count starts again.

    So it is where the hole is seen to be empty, and is not.
    """

    node_type = "Condition"

    part = InputPort(Part, "type of the part in the gripper")
    position = InputPort(Hole, "hole it should go into")
    tries = InputPort(int, "how many times", default=3)

    def update(self) -> Status:
        part, position = self.part.get(), self.position.get()
        memory, where = self.memory, _where(part, position)
        if memory.unplaced.get(where, 0) < self.tries.get():
            return Status.FAILURE
        memory.unplaced = without(memory.unplaced, where)
        self.feedback_message = f"the {self.tools.product.title(part)} does not go into {position}"
        memory.failed(self.feedback_message)
        return Status.SUCCESS


class VerifyPlacement(CellNode):
    """Check that the hole now holds the part, upright."""

    part = InputPort(Part, "type of the placed part")
    position = InputPort(Hole, "hole it was put into")
    timeout_s = InputPort(float, "longest wait for a clear view showing it", default=2.0, least=0)

    _begun_s = 0.0

    def initialise(self) -> None:
        self._begun_s = self.now.observation.time_s

    def update(self) -> Status:
        part, position = self.part.get(), self.position.get()
        view = self.now.observation.bench
        hole = view.holes.get(position) if view else None
        if hole is not None and hole.seen_s > self._begun_s and hole.part == part and hole.upright:
            self.feedback_message = f"{part} is at {position}"
            return Status.SUCCESS
        seen = "nothing" if hole is None else f"{hole.part or 'nothing'}{'' if hole.upright else ', tilted'}"
        self.feedback_message, self.what_if = f"sees {seen} at {position}", f"if {part} were seen upright at {position}"
        late = self.now.observation.time_s - self._begun_s > self.timeout_s.get()
        return Status.FAILURE if late else Status.RUNNING


class RecordPlacement(CellNode):
    """Set the edge of the part that the robot placed (Alg. 1 line 19)."""

    state = InOutPort(AssemblyState, "what is placed so far")
    part = InputPort(Part, "type of the placed part")
    position = InputPort(Hole, "hole it was put into")

    def update(self) -> Status:
        part, position = self.part.get(), self.position.get()
        state = self.state.get()
        by_robot = {**state.by_robot, position: part}
        self.state.set(replace(state.with_placement(part, position), by_robot=by_robot))
        self.now.show(message=f"placed {part} at {position}")
        self.tools.journal.note("belief", edge=[part, position], source="robot")
        return Status.SUCCESS


def _where(part: str, position: str) -> str:
    return f"{part} at {position}"
