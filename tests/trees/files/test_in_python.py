"""Trees that are written in Python: the same checks, the same nodes, and the same XML as those of a file."""

from __future__ import annotations

import inspect
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import btxml
from bracket_cell.trees import Bench, load_tree, tree
from bracket_cell.trees.node_library import node_registry
from bracket_cell.trees.nodes.moving import MoveTo
from bracket_cell.trees.nodes.placing import PlacePart
from bracket_ground.errors import InputError
from bracket_ground.interfaces.clock import ManualClock
from btxml import (
    AlwaysSuccess,
    Fallback,
    InputPort,
    Inverter,
    Node,
    OutputPort,
    Parallel,
    Precondition,
    RetryUntilSuccessful,
    Script,
    Sequence,
    Status,
    SubTree,
    Tree,
)
from btxml.engine.literals import from_text, to_text
from btxml.engine.node import TreeNode
from btxml.files.compile.registry import BUILT_IN, Registry
from tests.trees.engine.random_trees import Features, Generator


class Counts(Node):
    """Succeeds at every n-th tick."""

    n = InputPort(int, "succeeds at every n-th tick")
    tried = OutputPort(int, "ticks so far")
    _ticks = 0

    def update(self) -> Status:
        self._ticks += 1
        self.tried.set(self._ticks)
        return Status.FAILURE if self._ticks % self.n.get() else Status.SUCCESS


def test_a_tree_in_python_runs() -> None:
    made = tree(
        Fallback("either", [Inverter("not", AlwaysSuccess()), Counts("third", n=3, tried="{tried}")]),
        provided={},
    )
    made.setup(None, ManualClock())
    assert [made.tick().name for _ in range(3)] == ["FAILURE", "FAILURE", "SUCCESS"]
    assert made.blackboard.values() == {"tried": 3}
    assert [node.full_path for node in made.nodes] == ["either", "not", "AlwaysSuccess::3", "third"]


def test_one_import_makes_a_leaf_and_its_test() -> None:
    bench = Bench(
        RetryUntilSuccessful("again", Counts(n="{=}", tried="{t}"), num_attempts=9), real=[Counts], provided={"n": 3}
    )
    assert [bench.tick() for _ in range(3)] == ["R", "R", "S"]
    assert bench.tree.blackboard.entry("t").value == 3


def facts(made: Tree) -> list[object]:
    names = [(type(node).__name__, node.name, node.full_path) for node in made.nodes]
    return [made.name, names, made.origins]


def test_what_is_written_reads_back_equal(tmp_path: Path) -> None:
    fetch = Sequence("fetch", [Script(code="part := 'o1'"), Counts(n=2, _skipIf="part == 'o2' && true")])
    top = Parallel("both", [SubTree(ID="Fetch", part="{part}"), SubTree("again", ID="Fetch")], success_count=1)
    made = tree(Sequence("top", [top, Precondition("asks", AlwaysSuccess(), if_="part == 'o1'", else_=Status.SKIPPED)]),
        "Job", {"Fetch": fetch})  # fmt: skip
    file = tmp_path / "job.xml"
    file.write_text(made.xml)
    assert facts(load_tree(file, node_registry().extended([Counts]))) == facts(made)


def test_a_mistake_is_told_with_its_line_of_python() -> None:
    line = inspect.currentframe().f_lineno + 2  # type: ignore[union-attr]
    with pytest.raises(InputError) as raised:
        tree(Sequence("s", [Counts(m=3)]))
    assert [str(problem).partition(": ")[::2] for problem in raised.value.problems] == [
        (f"{__file__}:{line}", "Counts has no port 'm'; legal: n, tried"),
        (f"{__file__}:{line}", "Counts needs port 'n'; n: int or {entry} (succeeds at every n-th tick)"),
    ]


@pytest.mark.parametrize(
    ("root", "told"),
    [
        (Parallel("p", [MoveTo(pose="look"), MoveTo(pose="park")]), "commands the arm while MoveTo may"),
        (Sequence("s", [PlacePart(part="o1", position="p1")]), "runs without a guard"),
        (Sequence("s", [Script(code="n := ")]), "bad script"),
        (Inverter("i"), "it takes 1"),
        (SubTree(ID="Nowhere"), "there is no BehaviorTree 'Nowhere'"),
        (Counts(n="{never}"), "never"),
    ],
)
def test_the_checks_are_those_of_files(root: Node, told: str) -> None:
    for make in (tree, Bench):
        with pytest.raises(InputError) as raised:
            make(root)
        assert told in str(raised.value)


def test_a_bench_refuses_entries_that_the_tree_does_not_have() -> None:
    with pytest.raises(InputError, match="'m' is given, and the main tree has no such entry"):
        Bench(Counts(n="{n}"), provided={"n": 1, "m": 2})


def test_every_node_of_the_language_is_at_the_front_door() -> None:
    for node in BUILT_IN:
        assert getattr(btxml, node.__name__) is node
        assert node.__name__ in btxml.__all__


VALUES = st.one_of(
    *(st.booleans(), st.integers(-(2**62), 2**62), st.floats(allow_nan=False, allow_infinity=False), st.text()),
    *(st.lists(st.integers(-9, 9)), st.sampled_from([one for one in Status if one is not Status.INVALID])),
)


@given(VALUES)
def test_a_value_is_written_as_it_is_read(value: object) -> None:
    kind = list[int] if isinstance(value, list) else type(value)
    assert from_text(to_text(value), kind) == value


def again(made: Tree) -> TreeNode:
    """A loaded tree without SubTrees, written anew in Python."""
    here = {}
    for node, origin in zip(made.nodes, made.origins, strict=True):
        ports = {key: value for key, value in origin.attributes.items() if key != "name"}
        here[node] = type(node)(node.name, [], **ports)
    for node, other in here.items():
        other.children = [here[child] for child in node.children]
    return here[made.root]


def test_random_trees_in_python_are_those_of_files(tmp_path: Path) -> None:
    class Leaf(Node):
        """Does nothing."""

    class Check(Node):
        """Does nothing."""

    registry = Registry([Leaf, Check])
    count = 0
    for seed in range(200):
        case = Generator(seed, 20, Features(skips=True, scripts=True, data=True)).case()
        file = tmp_path / "tree.xml"
        file.write_text(case.xml)
        if "<SubTree" in case.xml:
            continue
        try:
            loaded = load_tree(file, registry)
        except InputError:
            continue  # a child that is never ticked
        count += 1
        made = tree(again(loaded), registry=registry)
        assert facts(made) == facts(loaded)
        file.write_text(made.xml)
        assert facts(load_tree(file, registry)) == facts(made)
    assert count > 40
