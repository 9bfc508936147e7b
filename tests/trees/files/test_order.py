"""Entries read before anything can have written them: found where certain, and never where a value was ever read."""

from __future__ import annotations

import random
import re
from pathlib import Path
from typing import ClassVar

import pytest

from bracket_cell.trees.node_library import node_registry
from bracket_ground.interfaces.clock import ManualClock
from btxml.engine.blackboard import UNSET
from btxml.engine.errors import Problem
from btxml.engine.node import Node
from btxml.engine.ports import InputPort, OutputPort
from btxml.engine.status import Status
from btxml.files.check import check
from btxml.files.compile.registry import Registry
from btxml.files.loader import build
from btxml.files.parse.library import read_library
from tests.trees.engine.random_trees import Features, Generator

LETTERS = {"S": Status.SUCCESS, "F": Status.FAILURE, "R": Status.RUNNING}
NAMES = ("a", "b")
CONTROLS = (
    *("Sequence", "Fallback", "ReactiveSequence", "ReactiveFallback", "SequenceWithMemory", "AsyncSequence"),
    *("Parallel", "ParallelAll", "IfThenElse", "WhileDoElse", "TryCatch"),
)
DECORATORS = (
    *("Inverter", "ForceSuccess", "ForceFailure", 'Repeat num_cycles="2"', "KeepRunningUntilFailure"),
    *('RetryUntilSuccessful num_attempts="3"', 'RunOnce then_skip="false"', 'Timeout msec="900"'),
)
TICKS = 40


class Reads(Node):
    """Notes the places at which it found a value."""

    value = InputPort(str, "")

    served: ClassVar[set[str]] = set()
    answers = random.Random(0)

    def update(self) -> Status:
        if self.value.entry is not None and self.value.entry.value is not UNSET:
            self.served.add(self.name)
            return LETTERS[self.answers.choice("SSFR")]
        return Status.FAILURE


class Writes(Node):
    """Writes, and answers at random."""

    value = OutputPort(str, "")
    answers = random.Random(0)

    def update(self) -> Status:
        self.value.set("written")
        return LETTERS[self.answers.choice("SSFR")]


REGISTRY = Registry([Reads, Writes])


def random_nodes(draw: random.Random, depth: int = 0) -> str:
    if depth > 4 or draw.random() < 0.25:
        name = draw.choice(NAMES)
        kind = draw.choice(("Reads", "Reads", "Writes", "script"))
        if kind == "script":
            return draw.choice(
                (f"<Script code=\"{name} := 'x'\"/>", f"<Sleep msec='50' _onSuccess=\"{name} := 'x'\"/>")
            )
        return f'<{kind} value="{{{name}}}" name="{kind}{draw.getrandbits(40)}"/>'
    if draw.random() < 0.4:
        decorator = draw.choice(DECORATORS)
        return f"<{decorator}>{random_nodes(draw, depth + 1)}</{decorator.split()[0]}>"
    tag = draw.choice(CONTROLS)
    count = draw.randint(2, 3)
    return f"<{tag}>{''.join(random_nodes(draw, depth + 1) for _ in range(count))}</{tag}>"


def test_no_reader_that_was_ever_served_is_a_problem(tmp_path: Path) -> None:
    path, told = tmp_path / "tree.xml", 0
    for seed in range(100):
        draw = random.Random(seed)
        path.write_text(f'<root BTCPP_format="4"><BehaviorTree ID="Main">{random_nodes(draw)}</BehaviorTree></root>')
        Reads.answers = Writes.answers = draw
        Reads.served.clear()
        for _ in range(6):
            problems = run_to_the_end(path)
        late = {reader(path, problem) for problem in problems}
        told += bool(late)
        assert not late & Reads.served, f"seed {seed}: {problems}"
    assert told > 10


def run_to_the_end(path: Path) -> list[Problem]:
    """Tick a tree until it ends; what was wrong with the order of its readers."""
    library = read_library(path)
    tree, problems = build(library, REGISTRY, library.main, {})
    clock = ManualClock()
    tree.setup(None, clock)
    for _ in range(TICKS):
        if tree.tick() is not Status.RUNNING:
            break
        clock.sleep_until(clock.now_s() + 0.04)
    return [problem for problem in problems if "before anything has written it" in problem.what]


def reader(path: Path, problem: Problem) -> str:
    """Name of the node whose port is the problem; none for a script, which stands without a name."""
    assert (problem.place.line, problem.place.file) == (1, path)
    found = re.match(r'value="{\w}" name="(\w+)"', path.read_text()[(problem.place.column or 0) - 1 :])
    return found[1] if found else ""


@pytest.mark.parametrize("name", ["assemble", "clear_and_grasp", "commission"])
def test_shipped_trees_read_nothing_too_early(name: str) -> None:
    assert check([Path(f"trees/{name}.xml")], node_registry()) == []


def test_trees_that_write_first_are_no_problem(tmp_path: Path) -> None:
    class Leaf(Node):
        """As in the comparison with BehaviorTree.CPP, whose trees all run."""

        def update(self) -> Status:
            return Status.SUCCESS

    class Check(Leaf):
        """As well."""

    path = tmp_path / "tree.xml"
    registry = Registry([Leaf, Check])
    for seed in range(200):
        path.write_text(Generator(seed, 40, Features(skips=True, scripts=True, data=True)).case().xml)
        library = read_library(path)
        assert build(library, registry, library.main, {})[1] == []
