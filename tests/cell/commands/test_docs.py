"""`cell docs` shows the guides, and names of pages in the program's own messages are those of guides."""

from __future__ import annotations

import re

import pytest

from bracket_cell.commands.main import main
from bracket_ground.files.files import shipped
from tests import ROOT

PACKAGES = ("cell", "trees", "skills", "learned", "sim")
NAMED = re.compile(r"cell docs (?!PAGE)([\w/]+)")


def test_all_pages_are_listed_by_their_titles(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["docs"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert re.search(r"^shift +A shift", "\n".join(lines), re.MULTILINE)
    assert len(lines) == 1 + len(list((ROOT / "docs").rglob("*.md")))


@pytest.mark.parametrize("name", ["shift", "docs/shift.md", "Shift"])
def test_a_page_is_shown(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["docs", name]) == 0
    assert "cell run --shift" in capsys.readouterr().out


def test_a_page_that_there_is_not_is_answered_with_those_near_it(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["docs", "shfit"]) == 2
    assert "there is no page 'shfit', but shift; `cell docs` lists all" in capsys.readouterr().err


def test_messages_name_pages_that_there_are() -> None:
    texts = [path.read_text() for package in PACKAGES for path in (ROOT / package).rglob("*.py")]
    named = {name for text in texts for name in NAMED.findall(text)}
    assert "drivers" in named
    assert [name for name in named if not (shipped("bracket_cell", "docs") / f"{name}.md").is_file()] == []
