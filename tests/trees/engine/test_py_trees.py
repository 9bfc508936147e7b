"""py_trees in both directions: its behaviours as leaves, and our trees in its displays, visitors and trees."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import py_trees
import pytest
from py_trees import behaviours, common

from bracket_ground.interfaces.notes import ListJournal
from btxml.engine.hooks import ORDERS, Hooks
from btxml.engine.outside import LoggedAnswers
from btxml.engine.ports import InputPort, OutputPort
from btxml.engine.py_trees_adapter import PyTreesLeaf, as_py_trees
from btxml.engine.status import Status
from btxml.engine.tree import Tree
from tests import ROOT
from tests.trees.conftest import Load
from tests.trees.engine.test_nodes import Steps

BODY = (
    '<Sequence name="top"><AlwaysSuccess/><Inverter><AlwaysFailure/></Inverter>'
    '<Fallback name="either"><Steps answers="R"/></Fallback></Sequence>'
)


class Kept:
    """Services with a log, and what a log had."""

    def __init__(self, answers: LoggedAnswers | None = None) -> None:
        self.journal = ListJournal()
        self.answers = answers


class Counter(PyTreesLeaf):
    """py_trees' counter."""

    upto = InputPort(int, "ticks for which it runs")

    def make(self) -> Any:
        return behaviours.TickCounter(self.name, self.upto.get(), common.Status.SUCCESS)


class Remember(PyTreesLeaf):
    """py_trees' blackboard: two behaviours in one of its sequences."""

    def make(self) -> Any:
        first = behaviours.SetBlackboardVariable("set", "colour", "red", overwrite=True)
        return py_trees.composites.Sequence(
            "both", True, [first, behaviours.CheckBlackboardVariableExists("is", "colour")]
        )

    def read(self, made: Any) -> Any:  # noqa: ARG002 - py_trees keeps it for the whole process
        return py_trees.blackboard.Blackboard.get("/colour")


class Dummy(PyTreesLeaf):
    """py_trees' dummy, which runs for ever."""

    result = OutputPort(str)

    def make(self) -> Any:
        return behaviours.Dummy(self.name)


@pytest.fixture(autouse=True)
def _own_blackboard() -> Iterator[None]:
    yield
    py_trees.blackboard.Blackboard.clear()


def letters(tree: Tree, ticks: int) -> str:
    return "".join(tree.tick().name[0] for _ in range(ticks))


def test_behaviours_of_py_trees_are_leaves(load: Load) -> None:
    body = '<Sequence><Counter upto="3"/><Remember result="{colour}"/></Sequence>'
    to = Kept()
    tree = load(body, Counter, Remember, services=to)
    assert letters(tree, 4) == "RRRS"
    assert tree.blackboard.entry("colour").value == "red"
    notes = [fields for _, fields in to.journal.take()]
    assert [(note["node"], note["polls"]) for note in notes] == [("Counter::2", 4), ("Remember::3", 1)]


def test_a_halt_stops_the_behaviour(load: Load) -> None:
    to = Kept()
    tree = load('<Dummy result="{none}"/>', Dummy, services=to)
    assert letters(tree, 2) == "RR"
    made = vars(tree.nodes[0])["_behaviour"]
    assert made.status.name == "RUNNING"
    tree.halt()
    assert made.status.name == "INVALID"
    assert [fields["cancelled"] for _, fields in to.journal.take()] == [True]


def test_a_replay_makes_no_behaviour_and_ends_as_the_run(load: Load) -> None:
    body = '<Sequence><Counter upto="3"/><Remember result="{colour}"/></Sequence>'
    to = Kept()
    letters(load(body, Counter, Remember, services=to), 4)
    notes = to.journal.take()

    class Never(Remember):
        """The same, and nobody may make it."""

        abstract, tag = False, "Remember"

        def make(self) -> Any:
            raise AssertionError("a replay asks nobody")

    again = Kept(LoggedAnswers([dict(fields) for _, fields in notes]))
    tree = load(body, Counter, Never, services=again)
    py_trees.blackboard.Blackboard.clear()
    assert letters(tree, 4) == "RRRS"
    assert tree.blackboard.entry("colour").value == "red"
    assert again.journal.take() == notes


def test_a_behaviour_that_raises_fails(load: Load) -> None:
    class Wrong(Dummy):
        """Raises."""

        abstract = False

        def make(self) -> Any:
            return behaviours.Success(self.name)

        def read(self, made: Any) -> Any:
            return made  # no plain data

    tree = load("<Wrong/>", Wrong, services=Kept())
    assert tree.tick() is Status.FAILURE
    assert "no plain data" in tree.nodes[0].feedback_message


def test_display_visitors_and_dot_of_a_loaded_tree(load: Load) -> None:
    tree = load(BODY, Steps)
    shown = as_py_trees(tree)
    stock = py_trees.trees.BehaviourTree(shown)
    seen = py_trees.visitors.SnapshotVisitor()
    stock.visitors.append(seen)
    stock.tick()
    names = {behaviour.id: behaviour.name for behaviour in shown.iterate()}
    answers = {names[uid]: status.name for uid, status in seen.visited.items()}
    assert answers == {
        **{"AlwaysSuccess": "SUCCESS", "AlwaysFailure": "FAILURE", "Inverter": "SUCCESS"},
        **{"Steps": "RUNNING", "either": "RUNNING", "top": "RUNNING"},
    }
    text = py_trees.display.unicode_tree(shown, show_status=True)
    assert text.splitlines()[0] == "{-} top [*]"
    assert "-^- Inverter [✓]" in text
    assert "{o} either [*]" in text
    tip = shown.tip()
    assert tip is not None
    assert tip.name == "Steps"
    dot = py_trees.display.dot_tree(shown).to_string()
    assert all(name in dot for name in ("top", "either", "Steps", "octagon"))


def test_a_tree_of_ours_runs_inside_one_of_py_trees(load: Load) -> None:
    inner = load('<Sequence name="ours"><Steps answers="RS"/></Sequence>', Steps)
    last = behaviours.Success("last")
    root = py_trees.composites.Sequence("theirs", True, [as_py_trees(inner), last])
    stock = py_trees.trees.BehaviourTree(root)
    stock.tick()
    assert (root.status.name, inner.status.name) == ("RUNNING", "RUNNING")
    stock.tick()
    assert (root.status.name, last.status.name, inner.status.name) == ("SUCCESS", "SUCCESS", "INVALID")
    assert "ours" in py_trees.display.dot_tree(root).to_string()


def test_py_trees_halts_a_tree_of_ours_once(load: Load) -> None:
    tree = load(BODY, Steps)
    stock = py_trees.trees.BehaviourTree(as_py_trees(tree))
    stock.tick()
    stock.interrupt()
    stock.root.stop(common.Status.INVALID)
    assert {node.status for node in tree.nodes} == {Status.INVALID}
    assert [node.halts for node in tree.nodes if isinstance(node, Steps)] == [1]
    assert {behaviour.status for behaviour in stock.root.iterate()} == {common.Status.INVALID}


def test_a_monitors_hook_outlives_the_ticks_of_py_trees(load: Load) -> None:
    tree = load('<Sequence><Script code="x := 0"/><AlwaysFailure _onSuccess="x := 1"/></Sequence>')
    ORDERS["I"](Hooks(tree, lambda _: None), {"uid": 3, "mode": 1, "desired_status": "SUCCESS", "position": 0})
    shown = as_py_trees(tree)
    for _ in range(2):
        tree.blackboard.entry("x").value = 0
        shown.tick_once()
        assert tree.blackboard.values()["x"] == 1


def test_nothing_but_the_adapter_knows_py_trees() -> None:
    files = [file for package in ("engine", "ground", "cell", "sim", "lab") for file in (ROOT / package).rglob("*.py")]
    found = [file.name for file in files if re.search(r"^\s*(from|import) py_trees", file.read_text(), re.MULTILINE)]
    assert found == ["py_trees_adapter.py"]
