"""A node of a user's own, whose code a test changes."""

from bracket_cell.trees.nodes.services import CellNode
from btxml.engine.status import Status
from btxml.engine.traits import Traits

BEGINS_S = 1.0


class MayBegin(CellNode):
    """The robot may help."""

    node_type = "Condition"
    traits = Traits(instant=True)

    def update(self) -> Status:
        return Status.SUCCESS if self.now.observation.time_s >= BEGINS_S else Status.FAILURE
