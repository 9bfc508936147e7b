"""Overrides keep what the file says around a node."""

from __future__ import annotations

from pathlib import Path

import pytest

from bracket_ground.interfaces.clock import ManualClock
from btxml.engine.hooks import ORDERS, Hooks
from btxml.engine.node import Node
from btxml.engine.status import Status
from btxml.engine.traits import Traits
from btxml.engine.tree import Tree
from btxml.files.compile.registry import Registry
from btxml.files.loader import load_tree


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


def test_who_waits_at_a_breakpoint_that_is_gone_cannot_be_unlocked(tmp_path: Path) -> None:
    file = tmp_path / "tree.xml"
    file.write_text('<root BTCPP_format="4"><BehaviorTree ID="Main"><AlwaysSuccess/></BehaviorTree></root>')
    tree = load_tree(file, Registry())
    tree.setup(None, ManualClock())
    hooks = Hooks(tree, lambda _: None)
    ORDERS["I"](hooks, {"uid": 1, "mode": 0, "position": 0})
    assert tree.tick() is Status.RUNNING
    ORDERS["R"](hooks, {"uid": 1, "position": 0})
    with pytest.raises(ValueError, match="node 1 does not wait at a breakpoint"):
        ORDERS["U"](hooks, {"uid": 1, "position": 0, "desired_status": "SUCCESS", "remove_when_done": True})
    assert tree.tick() is Status.SUCCESS


@pytest.mark.parametrize("position", [0, 1])
def test_a_guard_that_a_monitor_lets_agree_has_agreed(tmp_path: Path, position: int) -> None:
    class Refuses(Node):
        """Never agrees."""

        traits = Traits(instant=True, guards=True)

        def update(self) -> Status:
            return Status.FAILURE

    class Places(Node):
        """Must be guarded."""

        traits = Traits(needs_guard=True)

        def update(self) -> Status:
            return Status.SUCCESS

    file = tmp_path / "tree.xml"
    body = "<ReactiveSequence><Refuses/><Places/></ReactiveSequence>"
    file.write_text(f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body}</BehaviorTree></root>')
    tree = load_tree(file, Registry([Refuses, Places]))
    tree.setup(None, ManualClock())
    assert tree.tick() is Status.FAILURE
    ORDERS["I"](Hooks(tree, lambda _: None), {"uid": 2, "mode": 1, "position": position, "desired_status": "SUCCESS"})
    assert tree.tick() is Status.SUCCESS
