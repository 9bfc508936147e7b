"""Hot reload: when an edit takes over, what carries over, and what is refused."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from io import StringIO
from pathlib import Path

import pytest
from py_trees.common import Status
from rich.console import Console

from cell.interfaces.clock import ManualClock
from cell.interfaces.journal import ListJournal
from cell.interfaces.observation import GripperState, ObjectStatus, Observation
from cell.interfaces.skill import Progress, Skill, SkillStatus
from cell.log.reader import read_log
from cell.log.replay import Replay
from cell.reload import WatchedTree
from cell.run import RunOptions, run
from cell.tally import Tally
from cell.witness import TickRecord
from tests.cell.fakes import FakeServices, FakeWitness, Rig
from trees.loader import load_tree
from trees.node import Node
from trees.nodes.skill_node import SkillNode
from trees.registry import Registry
from trees.tree import Tree


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

    journal: ListJournal = field(default_factory=ListJournal)


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


REGISTRY = Registry([Wait, Drive])


class Bench:
    """A watched tree that is ticked by hand."""

    def __init__(self, path: Path, nodes: str) -> None:
        self.path = path
        self._edits = 0
        self.edit(nodes)
        self.witness = FakeWitness()
        self.swaps: list[Tree] = []
        self.first = self.load()
        self.watched = WatchedTree(self.first, self.load, path, [self.witness], lambda tree, _: self.swaps.append(tree))
        self.services = NotingServices(Rig().services.observation)
        self.watched.setup(self.services, ManualClock())

    def load(self) -> Tree:
        return load_tree(self.path, REGISTRY)

    def edit(self, nodes: str) -> None:
        self._edits += 1
        self.path.write_text(
            f'<root BTCPP_format="4"><BehaviorTree ID="Main"><Sequence>{nodes}</Sequence></BehaviorTree></root>'
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
    begin = '<Fallback><ScriptCondition code="count == 3"/><Script code="count := 0"/></Fallback>'
    bench.edit(f"{begin}<Wait/>")
    assert bench.watched.tick() is Status.RUNNING
    assert bench.swaps == [bench.watched.tree]
    assert bench.watched.tree is not bench.first
    assert bench.watched.tree.blackboard.values() == {"count": 3}
    assert "not carried over: word" in bench.witness.messages[-1]


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
    assert len(bench.witness.messages) == 1
    assert "warning" in bench.witness.messages[0]
    assert f"{bench.path}:1:" in bench.witness.messages[0]
    assert "MakeTea" in bench.witness.messages[0]
    bench.edit("<Wait/><Wait/>")
    bench.watched.tick()
    assert bench.watched.tree is not bench.first


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
    rest = bench.services.observation
    holding = GripperState(0.0, True, ObjectStatus.CONTACT_CLOSING, 0.02, 0.0, 0)
    assert holding.holding
    bench.edit("<Wait/><Wait/>")
    for unsafe in (moving(rest), replace(rest, gripper=holding)):
        bench.services.observation = unsafe
        bench.watched.tick()
        assert bench.watched.tree is bench.first
    bench.services.observation = rest
    bench.watched.tick()
    assert bench.watched.tree is not bench.first


def test_a_file_that_vanishes_is_a_broken_edit(make: Callable[[str], Bench]) -> None:
    bench = make("<Wait/>")
    bench.path.unlink()
    assert bench.watched.tick() is Status.RUNNING
    assert "cannot be read" in bench.witness.messages[0]


class EditingTally(Tally):
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
    monkeypatch.setattr(EditingTally, "path", path, raising=False)
    monkeypatch.setattr("cell.run.Tally", EditingTally)
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
