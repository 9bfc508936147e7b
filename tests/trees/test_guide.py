"""The examples of docs/authoring.md are what the guide says they are: clean files that check, and tests that pass."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

from tests import ROOT
from trees.files.check import check
from trees.node_library import node_registry

BLOCK = re.compile(r"```(xml|python)\n(?:<!-- (.*?) -->|# (.*?\.py))\n(.*?)```", re.DOTALL)
FILES = {xml or python: text for _, xml, python, text in BLOCK.findall((ROOT / "docs" / "authoring.md").read_text())}
TREES = [name for name in FILES if name.endswith(".xml")]
MODULES = [name for name in FILES if name.endswith(".py")]


def module_name(file: str) -> str:
    return file.removesuffix(".py").replace("/", ".")


def guide_tests(file: str) -> dict[str, Callable[[], None]]:
    module = ModuleType(module_name(file))
    exec(compile(FILES[file], f"docs/authoring.md: {file}", "exec"), module.__dict__)
    return {name: value for name, value in vars(module).items() if name.startswith("test_") and callable(value)}


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the shipped trees and the guide's own, in which its examples run and its leaf can be imported."""
    shutil.copytree(ROOT / "trees", tmp_path / "trees", ignore=shutil.ignore_patterns("*.py", "nodes"))
    shutil.copytree(ROOT / "config", tmp_path / "config", ignore=shutil.ignore_patterns("*.py"))
    for name in TREES:
        (tmp_path / name).write_text(FILES[name])
    leaf = ModuleType("nodes.every_nth")
    exec(compile(FILES["nodes/every_nth.py"], "docs/authoring.md", "exec"), leaf.__dict__)
    monkeypatch.setitem(sys.modules, leaf.__name__, leaf)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def named_tests(slow: bool) -> list[tuple[str, str]]:
    files = [file for file in MODULES if ("pytest.mark.slow" in FILES[file]) == slow]
    return [(file, name) for file in files for name in re.findall(r"^def (test_\w+)", FILES[file], re.MULTILINE)]


def test_the_guide_has_examples_of_each_kind() -> None:
    assert len(TREES) >= 2
    assert "nodes/every_nth.py" in MODULES
    assert len(named_tests(slow=False)) >= 3
    assert len(named_tests(slow=True)) == 1


def test_trees_of_the_guide_have_no_mistakes(checkout: Path) -> None:
    assert check(sorted((checkout / "trees").glob("*.xml")), node_registry()) == []


@pytest.mark.parametrize("command", [["check"], ["format", "--check"]])
def test_python_of_the_guide_passes_make_check(command: list[str], tmp_path: Path) -> None:
    for name in MODULES:
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(FILES[name])
    sources = f"src = ['{tmp_path}', '{ROOT}']"  # so that imports are sorted as in the clone
    settings = ["--no-cache", "--config", str(ROOT / "pyproject.toml"), "--config", sources]
    ruff = [sys.executable, "-m", "ruff", *command, *settings, str(tmp_path)]
    done = subprocess.run(ruff, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize(("file", "name"), named_tests(slow=False))
@pytest.mark.usefixtures("checkout")
def test_tests_of_the_guide_pass(file: str, name: str) -> None:
    guide_tests(file)[name]()


@pytest.mark.slow
@pytest.mark.parametrize(("file", "name"), named_tests(slow=True))
@pytest.mark.usefixtures("checkout")
def test_tests_of_the_guide_on_the_simulated_cell_pass(file: str, name: str) -> None:
    guide_tests(file)[name]()
