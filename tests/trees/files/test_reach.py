"""What the checker believes of nodes is what they do: in random trees none ends otherwise than its class declares."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from bracket_ground.interfaces.clock import ManualClock
from btxml.engine.node import RUNNING, Node
from btxml.engine.status import ANY, Status
from btxml.engine.traits import Traits
from btxml.files.checks.reach import _Reach
from btxml.files.compile.registry import Registry
from btxml.files.parse.library import bottom_up, called, read_library
from tests.trees.engine.differential import Ours, Refused
from tests.trees.engine.random_trees import Features, Generator


class Leaf(Node):
    """A leaf that may skip itself, as those of the random trees do."""

    traits = Traits(results=lambda *_: ANY)

    def update(self) -> Status:
        return RUNNING


class Check(Leaf):
    """The same, as a condition."""


@pytest.mark.parametrize("features", [Features(), Features(skips=True, scripts=True, data=True, kinds=True)])
def test_nodes_end_as_their_classes_declare(features: Features, tmp_path: Path) -> None:
    ended = 0
    for seed in range(150):
        path = tmp_path / "tree.xml"
        case = Generator(seed, 30, features).case()
        try:
            ours = Ours(case, path, ManualClock())
        except Refused:
            continue
        library = read_library(path)
        reach = _Reach(Registry([Leaf, Check]))
        declared = {}
        for element in bottom_up(library):
            reach.take(element, called(library, element))
            declared[element.get("name")] = reach._ends[id(element)]
        answers: dict[str, set[Status]] = {}
        for node in ours._tree.nodes:
            vars(node)["execute"] = _noting(node.execute, answers.setdefault(node.name, set()))
        for _ in range(case.ticks):
            ours.tick()
        for name, found in answers.items():
            assert found <= declared[name], f"seed {seed}: {name} {found} {declared[name]}"
            ended += len(found)
    assert ended > 1000


def _noting(execute: Callable[[], Status], answers: set[Status]) -> Callable[[], Status]:
    def noted() -> Status:
        if (status := execute()) is not RUNNING:
            answers.add(status)
        return status

    return noted
