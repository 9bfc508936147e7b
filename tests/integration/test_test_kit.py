"""The public test kit: a tree of one's own on a simulated cell, and why it failed."""

from __future__ import annotations

from pathlib import Path

from bracket_sim.testing import simulated_cell

TREE = """<root BTCPP_format="4" main_tree_to_execute="M">
<BehaviorTree ID="M"><Sequence>
<Fallback><Timeout msec="100"><MoveTo pose="look"/></Timeout><AlwaysSuccess/></Fallback>
<ScriptCondition code="wanted == 'o2'"/>
</Sequence></BehaviorTree></root>
"""


def test_a_tree_that_fails_on_a_simulated_cell_says_why_in_its_outcome(tmp_path: Path) -> None:
    file = tmp_path / "mine.xml"
    file.write_text(TREE)
    with simulated_cell(goal="g0", person=False, parts=()) as cell:
        outcome, seen = cell.run(file, entries={"wanted": "o1"})
    told = "ScriptCondition (mine.xml:4): 'wanted == 'o2'' is false, wanted = 'o1'"
    assert (outcome.end, outcome.cause) == ("failed", told)
    assert "moving to look" in seen.reasons()
