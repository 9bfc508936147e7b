"""Cells are measured once for a key and the code behind it; pages say what was measured."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

import pytest

from bracket_ground.errors import InputError
from bracket_lab.experiments import experiments
from bracket_lab.experiments.experiments import (
    Cell,
    code_version,
    kept,
    markdown,
    measured,
    number,
    shown_share,
    write_sections,
)

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


def test_numbers_as_text() -> None:
    assert [number(value) for value in (0.25, 0.0, 1.0, 1.5)] == [".250", "0.000", "1.000", "1.500"]


def test_a_share_of_several_seeds_shows_the_ends_of_all_their_intervals() -> None:
    found = [({"seed": seed}, {"a": a, "a_low": a - 0.1, "a_high": a + 0.1}) for seed, a in ((1, 0.5), (2, 0.7))]
    assert shown_share(found, "a") == ".600 (.400 - .800)"
    assert shown_share(found, "a", seed=2) == ".700 (.600 - .800)"
    assert shown_share(found, "a", seed=3) == "-"


def test_figures_hold_the_tables_of_the_page(tmp_path: Path) -> None:
    table = markdown(("", "square"), [(str(number), str(number**2)) for number in range(2)])
    section = f"## Squares\nOf few numbers.\n\nSmall ones:\n\n{table}\n\nThe same again:\n\n{table}"
    for name in ("page.md", "figures.json"):
        write_sections("# A title\nWords.", [section], tmp_path / name, {"command": "`measure`", "date": "some day"})
    assert "| 1 | 1 |" in (tmp_path / "page.md").read_text()
    found = json.loads((tmp_path / "figures.json").read_text())
    assert (found["title"], found["about"]) == ("A title", "Words. date: some day.")
    told = {"title": "Squares", "command": "measure", "head": ["", "square"], "cells": [["0", "0"], ["1", "1"]]}
    first, second = found["tables"]
    assert first == {**told, "about": "Of few numbers. Small ones:"}
    assert second == {**told, "about": "The same again:"}
