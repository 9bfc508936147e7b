"""Hot reload: when an edit takes over, what carries over, and what is refused."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from io import StringIO
from pathlib import Path
from types import SimpleNamespace

import pytest
from rich.console import Console

from bracket_cell.log.read.reader import read_log
from bracket_cell.log.replay.replay import Replay
from bracket_cell.runs.options import RunOptions
from bracket_cell.runs.run import run
from bracket_cell.trees.loading import load_tree
from bracket_cell.trees.node_library import node_registry
from bracket_cell.trees.nodes.skill_node import SkillNode
from bracket_cell.watching.observer import TickRecord
from bracket_cell.watching.statistics import RunStatistics
from bracket_cell.wiring.reload import WatchedTree, take_over
from bracket_ground.interfaces.clock import ManualClock
from bracket_ground.interfaces.notes import ListJournal
from bracket_ground.interfaces.observation import GripperState, ObjectStatus, Observation
from bracket_ground.interfaces.planning import AssemblyState
from bracket_ground.interfaces.skill import Progress, Skill, SkillStatus
from btxml.engine.node import Node
from btxml.engine.status import Status
from btxml.engine.tree import Tree
from btxml.files.compile.registry import Registry
from tests import ROOT
from tests.cell.fakes import FakeObserver, FakeServices, Rig
from tests.trees.nodes.rig import services


class Wait(Node):
    """Run for ever; nothing moves."""

    ends = 0

    def update(self) -> Status:
        return Status.RUNNING

    def terminate(self, new_status: Status) -> None:  # noqa: ARG002
        self.ends += 1


@dataclass
class NotingServices(FakeServices):
    """What the loop renews, and a journal for the skill."""

    tools: SimpleNamespace = field(default_factory=lambda: SimpleNamespace(journal=ListJournal()))


class EndlessSkill:
    """A motion that does not end."""

    def poll(self, *_: object) -> Progress:
        return Progress(SkillStatus.RUNNING, "")

    def halt(self, *_: object) -> None:
        pass


class Drive(SkillNode):
    """Move for ever."""

    def make_skill(self) -> Skill:
        return EndlessSkill()


class Remembers(Node):
    """Counts its ticks, also those of the tree before."""

    persistent = ("ticks",)
    ticks = 0

    def update(self) -> Status:
        self.ticks += 1
        return Status.RUNNING


class NeedsDriver(Node):
    """Its driver is not there."""

    def prepare(self) -> None:
        raise RuntimeError("the driver is not there")

    def update(self) -> Status:
        return Status.RUNNING


REGISTRY = Registry([Wait, Drive, Remembers, NeedsDriver])


class Bench:
    """A watched tree that is ticked by hand."""

    def __init__(self, path: Path, nodes: str) -> None:
        self.path = path
        self._edits = 0
        self.edit(nodes)
        self.observer = FakeObserver()
        self.swaps: list[Tree] = []
        self.first = self.load()
        self.watched = WatchedTree(
            self.first, self.load, path, [self.observer], lambda tree, _: self.swaps.append(tree)
        )
        self.services = NotingServices(Rig().services.now)
        self.watched.setup(self.services, ManualClock())

    def load(self) -> Tree:
        return load_tree(self.path, REGISTRY)

    def edit(self, nodes: str, inputs: Sequence[str] = ()) -> None:
        self._edits += 1
        ports = "".join(f'<input_port name="{name}"/>' for name in inputs)
        model = f'<TreeNodesModel><SubTree ID="Main">{ports}</SubTree></TreeNodesModel>'
        self.path.write_text(
            f'<root BTCPP_format="4">{model}<BehaviorTree ID="Main"><Sequence>{nodes}</Sequence></BehaviorTree></root>'
        )
        os.utime(self.path, ns=(self._edits, self._edits))  # two edits may fall into one tick of the file system


@pytest.fixture
def make(tmp_path: Path) -> Callable[[str], Bench]:
    return lambda nodes: Bench(tmp_path / "tree.xml", nodes)


def moving(observation: Observation) -> Observation:
    return replace(observation, arm=replace(observation.arm, moving=True))


def test_an_edit_takes_over_with_the_blackboard(make: Callable[[str], Bench]) -> None:
    bench = make("<Script code=\"count := 3; word := 'x'\"/><Wait/>")
    bench.watched.tick()
    bench.edit('<ScriptCondition code="count == 3"/><Wait/>', inputs=("count",))
    assert bench.watched.tick() is Status.RUNNING
    assert bench.swaps == [bench.watched.tree]
    assert bench.watched.tree is not bench.first
    assert bench.watched.tree.blackboard.values() == {"count": 3}
    assert "not carried over: word" in bench.observer.messages[-1]


def test_nodes_remember_where_as_many_stand_in_the_edited_tree(make: Callable[[str], Bench]) -> None:
    bench = make("<Remembers/>")
    for nodes in ("<Wait/>", "<AlwaysSuccess/><Remembers/>", "<Remembers/><Remembers/>"):
        bench.watched.tick()
        bench.edit(nodes)
    bench.watched.tick()
    ticks = [node.ticks for tree in (bench.first, *bench.swaps) for node in tree.nodes if isinstance(node, Remembers)]
    assert ticks == [1, 1, 1, 0]


def test_an_edit_that_cannot_be_set_up_leaves_the_old_tree_running(make: Callable[[str], Bench]) -> None:
    bench = make("<Wait/>")
    bench.watched.tick()
    bench.edit("<NeedsDriver/>")
    assert bench.watched.tick() is Status.RUNNING
    assert bench.watched.tree is bench.first
    assert not bench.swaps
    assert "the driver is not there" in bench.observer.messages[-1]


def test_the_assembly_graph_outlives_an_edit_and_begins_anew_afterwards(tmp_path: Path) -> None:
    path = tmp_path / "tree.xml"
    start = '<StartGraph state="{state}"/>'
    path.write_text(WHOLE.format(f"{start}<Sleep msec='1'/>"))
    old, new = load_tree(path, node_registry()), load_tree(path, node_registry())
    rig = services()
    old.setup(rig, ManualClock())
    old.tick()
    old.blackboard.entry("state").write(AssemblyState({"p2": "o1"}))
    assert take_over(old, new, rig, ManualClock()) == []
    new.tick()
    assert new.blackboard.entry("state").value == AssemblyState({"p2": "o1"})
    assert "goes on with 1 parts" in [node.feedback_message for node in new.nodes]
    new.halt()
    new.tick()
    assert new.blackboard.entry("state").value == AssemblyState({})


def test_the_old_tree_is_halted_once(make: Callable[[str], Bench]) -> None:
    bench = make("<Wait/>")
    bench.watched.tick()
    bench.edit("<Wait/><Wait/>")
    bench.watched.tick()
    bench.watched.tick()
    wait = bench.first.nodes[1]
    assert isinstance(wait, Wait)
    assert wait.ends == 1
    assert bench.first.status is Status.INVALID


def test_a_broken_edit_is_refused_and_a_repaired_one_taken(make: Callable[[str], Bench]) -> None:
    bench = make("<Wait/>")
    bench.edit("<Wait/><MakeTea/>")
    for _ in range(3):
        assert bench.watched.tick() is Status.RUNNING
    assert bench.watched.tree is bench.first
    assert len(bench.observer.messages) == 1
    assert "warning" in bench.observer.messages[0]
    assert f"{bench.path}:1:" in bench.observer.messages[0]
    assert "MakeTea" in bench.observer.messages[0]
    bench.edit("<Wait/><Wait/>")
    bench.watched.tick()
    assert bench.watched.tree is not bench.first


@pytest.mark.parametrize("first", ["<Wait", "<Wait/>"])
def test_an_edit_that_is_saved_while_the_one_before_is_told_is_taken(
    make: Callable[[str], Bench], first: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = make("<Wait/>")
    bench.watched.tick()
    load = bench.load

    def loaded() -> Tree:
        try:
            return load()
        finally:
            bench.edit("<Remembers/>")

    bench.edit(first)
    monkeypatch.setattr(bench.watched, "_load", loaded)
    bench.watched.tick()
    monkeypatch.setattr(bench.watched, "_load", load)
    bench.watched.tick()
    assert [type(node) for node in bench.swaps[-1].nodes if isinstance(node, Remembers)] == [Remembers]


def test_an_edit_that_is_broken_again_before_the_safe_point_is_not_taken(make: Callable[[str], Bench]) -> None:
    bench = make("<Drive/>")
    bench.watched.tick()
    bench.edit("<Wait/>")
    bench.watched.tick()
    bench.edit("<Wait>")
    bench.watched.tick()
    bench.watched.halt()
    bench.watched.tick()
    assert bench.watched.tree is bench.first


def test_no_exchange_while_a_motion_node_runs(make: Callable[[str], Bench]) -> None:
    bench = make("<Drive/>")
    bench.watched.tick()
    bench.edit("<Wait/>")
    for _ in range(3):
        bench.watched.tick()
        assert bench.watched.tree is bench.first
    bench.watched.halt()
    bench.watched.tick()
    assert bench.watched.tree is not bench.first


def test_no_exchange_while_the_arm_moves_or_a_part_is_held(make: Callable[[str], Bench]) -> None:
    bench = make("<Wait/>")
    rest = bench.services.now.observation
    holding = GripperState(0.0, True, ObjectStatus.CONTACT_CLOSING, 0.02, 0.0, 0)
    assert holding.holding
    bench.edit("<Wait/><Wait/>")
    for unsafe in (moving(rest), replace(rest, gripper=holding)):
        bench.services.now.observation = unsafe
        bench.watched.tick()
        assert bench.watched.tree is bench.first
    bench.services.now.observation = rest
    bench.watched.tick()
    assert bench.watched.tree is not bench.first


def test_a_file_that_vanishes_is_a_broken_edit(make: Callable[[str], Bench]) -> None:
    bench = make("<Wait/>")
    bench.path.unlink()
    assert bench.watched.tick() is Status.RUNNING
    assert "cannot be read" in bench.observer.messages[0]


class EditingStatistics(RunStatistics):
    """Edits the tree in the tenth tick of a run."""

    path: Path

    def tick(self, record: TickRecord) -> None:
        super().tick(record)
        if record.observation.tick == 10:
            self.path.write_text(WHOLE.format("<AlwaysFailure/>"))


WHOLE = '<root BTCPP_format="4"><BehaviorTree ID="Main"><Sequence>{}</Sequence></BehaviorTree></root>'


def test_an_edit_takes_over_in_the_simulated_cell(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, log = tmp_path / "tree.xml", tmp_path / "log.mcap"
    path.write_text(WHOLE.format('<Sleep msec="4000"/>'))
    monkeypatch.setattr(EditingStatistics, "path", path, raising=False)
    monkeypatch.setattr("bracket_cell.runs.assembled.RunStatistics", EditingStatistics)
    result = run(RunOptions(tree=path, seed=1, goal="g0", log=log, watch=True), Console(file=StringIO()))
    assert result.outcome.end == "failed"
    assert result.outcome.ticks < 20
    read = read_log(log)
    edits = [
        (kind, "AlwaysFailure" in one["files"]["tree/tree.xml"]) for tick in read.ticks for kind, one in tick.inputs
    ]
    assert edits == [("edit", True)]
    assert b"Sleep" in read.attachments["tree/tree.xml"]
    comparison = Replay(read).run()
    assert (comparison.identical, comparison.ticks) == (True, len(read.ticks)), comparison.first


class ImpatientStatistics(RunStatistics):
    """Edits the running assembly: another order of work while watching, and another retry in the tray."""

    folder: Path

    def tick(self, record: TickRecord) -> None:
        super().tick(record)
        if record.observation.time_s >= 20.0 and not (self.folder / "edited").exists():
            swap(self.folder / "assemble.xml", "<ReconcileGraph", "<InferGoal")
            tray = self.folder / "clear_and_grasp.xml"
            tray.write_text(tray.read_text().replace('num_attempts="8"', 'num_attempts="6"'))
            (self.folder / "edited").touch()


def swap(path: Path, one: str, other: str) -> None:
    """Exchange the lines on which two nodes stand."""
    lines = path.read_text().splitlines(keepends=True)
    here, there = (next(i for i, line in enumerate(lines) if name in line) for name in (one, other))
    lines[here], lines[there] = lines[there], lines[here]
    path.write_text("".join(lines))


@pytest.mark.slow
def test_an_assembly_goes_on_with_its_graph_when_its_tree_is_edited(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("assemble.xml", "clear_and_grasp.xml"):
        (tmp_path / name).write_text((ROOT / "trees" / name).read_text())
    monkeypatch.setattr(ImpatientStatistics, "folder", tmp_path, raising=False)
    monkeypatch.setattr("bracket_cell.runs.assembled.RunStatistics", ImpatientStatistics)
    log, told = tmp_path / "log.mcap", StringIO()
    options = RunOptions(tree=tmp_path / "assemble.xml", seed=3, goal="g1", log=log, watch=True)
    result = run(options, Console(file=told, width=200))
    assert (result.outcome.end, result.summary["correct"]) == ("finished", True), told.getvalue()
    read = read_log(log)
    edits = [tick.time_s for tick in read.ticks for kind, _ in tick.inputs if kind == "edit"]
    assert len(edits) == 1
    notes = [fields for tick in read.ticks for topic, fields in tick.notes if topic == "belief" and "edge" in fields]
    placed = [(*fields["edge"], fields["source"]) for fields in notes]  # the robot's part may be seen before it is told
    assert len(placed) == len(set(placed)), "the graph was built again after the edit"
    assert Replay(read).run().identical
