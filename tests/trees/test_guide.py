"""The examples of docs/authoring.md are what the guide says they are: files that check, and tests that pass."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from cell.running.node_library import node_registry
from tests import ROOT
from trees.files.check import check

GUIDE = (ROOT / "docs" / "authoring.md").read_text()
BLOCK = re.compile(r"```(xml|python)\n(.*?)```", re.DOTALL)
BLOCKS = BLOCK.findall(GUIDE)


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the shipped trees and the guide's own, in which its examples run."""
    shutil.copytree(ROOT / "trees", tmp_path / "trees", ignore=shutil.ignore_patterns("*.py", "nodes"))
    for kind, text in BLOCKS:
        if kind == "xml":
            (tmp_path / text.split()[1]).write_text(text)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def guide_tests() -> dict[str, Callable[[], None]]:
    names: dict[str, object] = {"__name__": "guide"}
    exec(compile("\n".join(text for kind, text in BLOCKS if kind == "python"), "docs/authoring.md", "exec"), names)
    return {name: value for name, value in names.items() if name.startswith("test_") and callable(value)}


TESTS = guide_tests()
SLOW = [name for name, test in TESTS.items() if hasattr(test, "pytestmark")]


def test_the_guide_has_examples_of_each_kind() -> None:
    assert [kind for kind, _ in BLOCKS].count("xml") >= 2
    assert len(TESTS) >= 4
    assert len(SLOW) == 1


def test_trees_of_the_guide_have_no_mistakes(checkout: Path) -> None:
    assert check(sorted((checkout / "trees").glob("*.xml")), node_registry()) == []


@pytest.mark.parametrize("name", [name for name in TESTS if name not in SLOW])
@pytest.mark.usefixtures("checkout")
def test_tests_of_the_guide_pass(name: str) -> None:
    TESTS[name]()


@pytest.mark.slow
@pytest.mark.parametrize("name", SLOW)
@pytest.mark.usefixtures("checkout")
def test_tests_of_the_guide_on_the_simulated_cell_pass(name: str) -> None:
    TESTS[name]()
