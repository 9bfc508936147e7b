"""Random trees behave here as in BehaviorTree.CPP: leaf order, halts, root status and blackboard, tick by tick."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.trees.differential import REFUSED, Generator, run_ours, run_theirs

MODES = {"plain": (False, False), "scripts": (False, True), "skips": (True, False), "all": (True, True)}


def assert_same(seeds: range, size: int, mode: str, path: Path) -> None:
    skips, scripts = MODES[mode]
    refused = 0
    for seed in seeds:
        case = Generator(seed, size, skips, scripts).case()
        log = run_ours(case, path)
        assert log == run_theirs(case), f"seed {seed}: {case}"
        refused += log == REFUSED
    assert refused <= len(seeds) / 100, "trees that both sides refuse prove nothing"


@pytest.mark.parametrize("mode", MODES)
def test_random_trees_run_as_in_behaviortree_cpp(mode: str, tmp_path: Path) -> None:
    assert_same(range(500), 40, mode, tmp_path / "tree.xml")


@pytest.mark.slow
@pytest.mark.parametrize("mode", MODES)
def test_many_random_trees_run_as_in_behaviortree_cpp(mode: str, tmp_path: Path) -> None:
    assert_same(range(500, 5500), 40, mode, tmp_path / "tree.xml")
