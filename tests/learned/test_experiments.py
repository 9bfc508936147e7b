"""Cells are measured once for a key and the code behind it."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pytest

from bracket_ground.errors import InputError
from bracket_lab.experiments import experiments
from bracket_lab.experiments.experiments import Cell, code_version, kept, measured

asked: list[int] = []


@pytest.fixture(autouse=True)
def nothing_asked() -> None:
    asked.clear()


def measure(number: int) -> dict[str, int]:
    asked.append(number)
    if number == 2 and asked.count(2) == 1:
        raise KeyboardInterrupt
    return {"square": number**2}


def cells() -> list[Cell]:
    return [Cell({"number": number}, partial(measure, number)) for number in range(4)]


def test_finished_cells_are_not_measured_again(tmp_path: Path) -> None:
    path = tmp_path / "new" / "cells.jsonl"
    with pytest.raises(KeyboardInterrupt):
        measured("a test", cells(), kept(path), quiet=True)
    assert asked == [0, 1, 2]
    found = measured("a test", cells(), kept(path), quiet=True)
    assert asked == [0, 1, 2, 2, 3]
    assert [values["square"] for _, values in found] == [0, 1, 4, 9]
    path.write_text("no JSON\n")
    with pytest.raises(InputError, match=r"cells\.jsonl:1: no row of name"):
        kept(path)


def test_other_code_measures_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    measured("a test", cells()[:2], kept(tmp_path / "cells"), quiet=True)
    monkeypatch.setattr(experiments, "code_version", lambda _: "another")
    measured("a test", cells()[:2], kept(tmp_path / "cells"), quiet=True)
    assert asked == [0, 1, 0, 1]


def test_the_version_of_code_follows_imports_and_forgets_words(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(experiments, "_ROOT", tmp_path)

    def version(first: str, second: str) -> str:
        (tmp_path / "first.py").write_text(first)
        (tmp_path / "second.py").write_text(second)
        code_version.cache_clear()
        return code_version("first")

    before = version("import second\n", "x = 1\n")
    assert version('"""A text."""\nimport second  # a remark\n', "x = 1\n") == before
    assert version("import second\n", "x = 2\n") != before
    assert version("import second\ny = 1\n", "x = 1\n") != before
    code_version.cache_clear()


def test_the_code_of_this_project_is_found() -> None:
    assert code_version("bracket_lab.experiments.experiments") != code_version("bracket_lab.experiments.no_such_module")
