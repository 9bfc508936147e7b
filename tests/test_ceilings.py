"""The house holds its size."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from tests.ceilings import DISTRIBUTIONS, ROOT, problems, sizes

TOP = {*DISTRIBUTIONS, "config", "docs", "editor", "learned", "skills", "tests", "trees"}
FILES = {"CHANGELOG.md", "LICENSE", "Makefile", "README.md", "mkdocs.yml", "pyproject.toml"}


@pytest.fixture
def house(tmp_path: Path) -> Path:
    """Five distributions, each with a room of one file of three lines."""
    for folder, top in DISTRIBUTIONS.items():
        room = tmp_path / folder / top / "room"
        room.mkdir(parents=True)
        (room / "__init__.py").write_text("1\n2\n3\n")
    return tmp_path


def test_a_room_over_its_ceiling_is_named_with_both_numbers(house: Path) -> None:
    ceilings = {name: [3, 1] for name in sizes(house)}
    assert problems(sizes(house), ceilings) == []
    (house / "engine" / "btxml" / "room" / "more.py").write_text("4\n")
    assert problems(sizes(house), ceilings) == [
        "btxml: 4 lines in 2 files; its ceiling is 3 in 1",
        "btxml.room: 4 lines in 2 files; its ceiling is 3 in 1",
    ]


def test_a_new_room_needs_a_ceiling_and_one_that_is_gone_must_go(house: Path) -> None:
    ceilings = {name: [3, 1] for name in sizes(house) if name != "bracket_sim.room"} | {"bracket_sim.old": [3, 1]}
    assert problems(sizes(house), ceilings) == [
        "bracket_sim.room: no ceiling; it has 3 lines in 1 files",
        "bracket_sim.old: there is no such room",
    ]


def test_nothing_that_a_command_wrote_lies_at_the_top() -> None:
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True)
    names = {line.split("/")[0] for line in listed.stdout.splitlines()}
    pinned = {"constraints.txt", "constraints-hashed.txt"}
    assert {name for name in names if not name.startswith(".")} == TOP | FILES | pinned
