"""What a person is told follows from fields: what a node's traits say, and the placement that a verdict names."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from bracket_cell.trees.loading import load_tree
from bracket_cell.trees.node_library import node_registry
from bracket_cell.viewing.instruction import NEAR_S, OperatorGuide
from bracket_cell.watching.observer import SentCommand, TickRecord
from bracket_ground.interfaces.command import Command, Display
from bracket_ground.interfaces.faults import Judgement
from bracket_ground.interfaces.observation import Observation
from btxml.engine.node import StatusChange
from btxml.engine.status import Status
from tests.trees.nodes.rig import EMPTY_GRIPPER, PRODUCT, STANDING

OWN = """
from btxml import Node, Status
from btxml.engine.traits import Traits


class StandBackPlease(Node):
    \"\"\"Waits for a visitor.\"\"\"

    traits = Traits({traits})

    def update(self) -> Status:
        return Status.RUNNING
"""
TREE = """<root BTCPP_format="4" main_tree_to_execute="Mine">
  <BehaviorTree ID="Mine"><StandBackPlease name="PlacePart"/></BehaviorTree>
</root>"""


@pytest.mark.parametrize(("traits", "moment"), [('shown_as="gives way"', "waits"), ("", "unknown")])
def test_a_leaf_of_ones_own_that_gives_way_is_told(tmp_path: Path, traits: str, moment: str) -> None:
    """Its class and its name tell nothing: here it is named as a leaf of the library that places."""
    own, file = tmp_path / "own_leaves.py", tmp_path / "mine.xml"
    own.write_text(OWN.format(traits=traits))
    file.write_text(TREE)
    tree = load_tree(file, node_registry(PRODUCT, (str(own),)))
    instructor = OperatorGuide(PRODUCT, lambda: tree)
    seen = Observation(0, 0.0, replace(STANDING, moving=True), EMPTY_GRIPPER)
    display = Display(goal_belief={"g0": 1.0}, guidance={})
    running = StatusChange(tree.nodes[0].full_path, tree.nodes[0].uid, Status.INVALID, Status.RUNNING, "")
    verdict = ("verdict", {"part": "o2", "position": "p4", "decision": "act", "subject": "", "reason": ""})
    for number in range(2):
        instructor.take(
            TickRecord(
                replace(seen, tick=number, time_s=number * (NEAR_S + 0.6)),
                "RUNNING",
                (running,) * (number == 0),
                (verdict,) * (number == 0),  # type: ignore[arg-type]
                Command(display=display),
                SentCommand(),
                0.001,
                False,
                judgement=Judgement(),
            )
        )
    assert instructor.next == ("o2", "p4")
    assert instructor.now().moment == moment
