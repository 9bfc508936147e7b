"""A goal that somebody shows by assembling one bracket."""

from __future__ import annotations

from py_trees.common import Status

from cell.interfaces.errors import InputError
from cell.interfaces.planning import AssemblyState
from trees.engine.errors import NodeError
from trees.engine.node import FAILURE, SUCCESS
from trees.engine.ports import InputPort
from trees.nodes.services import CellNode


class TeachGoal(CellNode):
    """Note what is assembled as a goal; fails while the cameras see anything else in a hole than is believed."""

    name_given = InputPort(str, "how the goal is to be called", name="goal")
    state = InputPort(AssemblyState, "what is placed so far")

    def update(self) -> Status:
        services, placed, seen = self.services, self.state.get().placed, self.services.observation.bench
        for position in services.product.positions:
            hole = seen.holes.get(position) if seen is not None else None
            if hole is None or hole.part is None or hole.part != placed.get(position) or not hole.upright:
                self.feedback_message = f"{position} is not sure: {placed.get(position, 'nothing')} is believed there"
                return FAILURE
        if services.teach is None:
            raise NodeError("goals are kept nowhere: set planners.semantic.goals in the configuration")
        parts = tuple(placed[position] for position in services.product.positions)
        try:
            name = services.teach(self.name_given.get(), parts)
        except InputError as error:
            raise NodeError(str(error)) from None
        self.feedback_message = f"goal {name}: {' '.join(parts)}"
        services.show(message=f"learned goal {name}")
        services.journal.note("belief", goal=name, parts=list(parts), source="shown")
        return SUCCESS
