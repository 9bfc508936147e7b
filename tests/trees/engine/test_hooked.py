"""Overrides keep what the file says around a node."""

from __future__ import annotations

from pathlib import Path

import pytest

from cell.interfaces.clock import ManualClock
from trees.engine.hooks import ORDERS, Hooks
from trees.engine.status import Status
from trees.engine.tree import Tree
from trees.files.build.registry import Registry
from trees.files.loader import load_tree


def hooked(folder: Path, node: str, answer: str = "SUCCESS") -> Tree:
    """A tree of one node whose work is replaced."""
    file = folder / "tree.xml"
    start = '<Script code="x := 0"/>'
    body = f"<Sequence>{start}<ForceSuccess>{node}</ForceSuccess></Sequence>"
    file.write_text(f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body}</BehaviorTree></root>')
    tree = load_tree(file, Registry())
    tree.setup(None, ManualClock())
    ORDERS["I"](Hooks(tree, lambda _: None), {"uid": 4, "mode": 1, "desired_status": answer, "position": 0})
    return tree


@pytest.mark.parametrize(
    ("conditions", "answer", "x"),
    [
        ('_onSuccess="x := 1" _post="x += 10"', "SUCCESS", 11),
        ('_onFailure="x := 2" _post="x += 10"', "FAILURE", 12),
        ('_skipIf="true" _onSuccess="x := 1"', "SUCCESS", 0),
        ('_failureIf="x == 0" _onSuccess="x := 1" _onFailure="x := 5"', "SUCCESS", 5),
        ('_while="false" _onSuccess="x := 1"', "SUCCESS", 0),
        ('_post="x := 1 / 0"', "SUCCESS", 0),
    ],
)
def test_conditions_hold_around_a_replaced_node(tmp_path: Path, conditions: str, answer: str, x: int) -> None:
    tree = hooked(tmp_path, f"<AlwaysFailure {conditions}/>", answer)
    assert tree.tick() is Status.SUCCESS
    assert tree.blackboard.values()["x"] == x
