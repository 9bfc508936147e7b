"""What nodes remember stands on the blackboard, for scripts, monitors and logs."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from pydantic import TypeAdapter

from bracket_cell.recording.json_schema import with_nulls, without_nulls
from bracket_cell.recording.rotation import Snapshot
from bracket_cell.recording.schemas import json_bytes, plain
from bracket_cell.trees.bench import TreeBench
from bracket_cell.trees.loading import load_tree
from bracket_cell.trees.node_library import node_registry
from bracket_cell.wiring.reload import take_over
from bracket_ground.errors import InputError
from bracket_ground.interfaces.clock import ManualClock
from bracket_ground.interfaces.memory import PREFIX, Memory, more, without
from bracket_ground.interfaces.notes import ListJournal
from bracket_ground.interfaces.planning import AssemblyState
from bracket_ground.interfaces.resume import ResumeState
from btxml.engine.node import Node
from btxml.engine.ports import InputPort
from btxml.engine.status import Status
from btxml.engine.tree import Tree
from btxml.files.compile.registry import Registry
from btxml.views.groot2 import blackboards
from tests.trees.nodes.rig import PRODUCT, seen_parts, services

WHOLE = '<root BTCPP_format="4" main_tree_to_execute="Main"><BehaviorTree ID="Main">{}</BehaviorTree>{}</root>'
HOLDS = """<ScriptCondition code="@memory_held_part == 'o2' &amp;&amp; !@memory_held_lying"/>"""
Load = Callable[..., Tree]


@pytest.fixture
def load(tmp_path: Path) -> Load:
    """Loads a tree with the nodes of the cell."""

    def load_nodes(nodes: str, more_trees: str = "", registry: Registry | None = None) -> Tree:
        path = tmp_path / "tree.xml"
        path.write_text(WHOLE.format(nodes, more_trees))
        return load_tree(path, registry or node_registry())

    return load_nodes


def filled() -> Memory:
    """A memory of which no field is as at the beginning."""
    parts = seen_parts("o1", "o2").seen
    goal = tuple(PRODUCT.goal_placements("g0").values())
    left = ResumeState(AssemblyState({"p1": "o1"}, "g0", kept={"p2": "o2"}), 3, False, "o1", (goal,))
    counts: dict[str, Any] = {"reasons": {"it slipped": 2}, "turned": {"o2": 1}, "unplaced": {"o1 at p2": 3}}
    lists: dict[str, Any] = {"tray_parts": parts, "put_down": parts[:1], "in_vain": parts[1:], "finished": (goal,)}
    return Memory("o2", True, tray_seen_s=3.25, questions=4, brackets=2, left_off=left, **counts, **lists)


def test_a_script_and_a_subtree_see_what_was_remembered_in_the_same_tick(load: Load) -> None:
    inner = f'<BehaviorTree ID="Inner">{HOLDS}</BehaviorTree>'
    tree, to = load('<SubTree ID="Inner"/>', inner), services()
    tree.setup(to, ManualClock())
    assert tree.tick() is Status.FAILURE
    to.memory.held_part = "o2"
    assert tree.tick() is Status.SUCCESS
    assert blackboards(tree, ["Main"])["Main"]["memory_held_part"] == "o2"


def test_a_port_reads_it_in_its_own_type(load: Load) -> None:
    class Counts(Node):
        """Succeeds from the second bracket on."""

        done = InputPort(int, "brackets so far")

        def update(self) -> Status:
            return Status.SUCCESS if self.done.get() > 1 else Status.FAILURE

    registry = node_registry().extended([Counts])
    tree, to = load('<Counts done="{memory_brackets}"/>', registry=registry), services(brackets=2)
    tree.setup(to, ManualClock())
    assert tree.tick() is Status.SUCCESS
    with pytest.raises(InputError, match=r"port 'done' of Counts is given \{@memory_tray_parts\}"):
        load('<Counts done="{@memory_tray_parts}"/>', registry=registry)


@pytest.mark.parametrize(
    "nodes",
    ["<Script code=\"@memory_held_part := 'o1'\"/>", '<SetBlackboard value="1" output_key="memory_brackets"/>'],
)
def test_a_tree_that_writes_it_is_refused(load: Load, nodes: str) -> None:
    with pytest.raises(InputError, match="which only the cell itself writes"):
        load(nodes)


def test_a_field_that_does_not_exist_is_refused(load: Load) -> None:
    with pytest.raises(InputError, match=r"reads \{@memory_held\}, which nothing writes"):
        load("<ScriptCondition code=\"@memory_held == 'o1'\"/>")


def test_only_what_changes_is_noted_and_the_beginning_whole(load: Load) -> None:
    tree, to = load("<AlwaysSuccess/>"), services()
    tree.setup(to, ManualClock())
    journal = to.tools.journal
    assert isinstance(journal, ListJournal)
    assert journal.take() == (("memory", Memory().values()),)
    to.memory.held_part = "o1"
    to.memory.held_part = "o1"
    to.memory.turned = without(to.memory.turned, "o1")
    to.memory.unplaced = more(to.memory.unplaced, "o1 at p2")
    assert journal.take() == (("memory", {"held_part": "o1"}), ("memory", {"unplaced": {"o1 at p2": 1}}))


def test_what_a_snapshot_says_of_it_is_json_and_can_be_read_back(load: Load) -> None:
    tree, to = load("<AlwaysSuccess/>"), services()
    to.memory = filled()
    tree.setup(to, ManualClock())
    told = json.loads(json_bytes(without_nulls(Snapshot(tree.blackboard.values).fields(7))))["blackboard"]
    fields = {name.removeprefix(PREFIX): value for name, value in told.items() if name.startswith(PREFIX)}
    assert fields == without_nulls(plain(to.memory))
    assert TypeAdapter(Memory).validate_python(with_nulls(Memory, fields)) == filled()


def test_an_edited_tree_has_it_and_sees_what_changes(load: Load) -> None:
    old, new, to = load("<AlwaysSuccess/>"), load(HOLDS), services(held_part="o2")
    old.setup(to, ManualClock())
    assert take_over(old, new, to, ManualClock()) == []
    assert new.tick() is Status.SUCCESS
    to.memory.held_lying = True
    assert new.tick() is Status.FAILURE
    assert old.blackboard.entry("memory_held_lying").value is False


def test_a_tree_is_tried_on_a_bench_with_a_memory_that_the_test_gives(tmp_path: Path) -> None:
    path = tmp_path / "tree.xml"
    path.write_text(WHOLE.format(HOLDS, ""))
    assert TreeBench(path, provided={"memory_held_part": "o2"}).tick() == "S"
    assert TreeBench(path).tick() == "F"
