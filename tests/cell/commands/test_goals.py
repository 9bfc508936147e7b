"""`cell goals`: a table that can be read, also of a product with many holes, and answers to what was done."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from bracket_cell.commands.goals import goals_app
from bracket_cell.configuration import load_configuration, load_product

GOAL = tuple(load_product(load_configuration()).goal_placements("g0").values())
NEW = (*GOAL[1:], GOAL[0])


def asked(*arguments: str) -> str:
    answer = CliRunner().invoke(goals_app, list(arguments))
    assert answer.exit_code == 0, answer.output
    return answer.output


def test_what_was_added_is_told_and_listed_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    file = str(tmp_path / "goals.yaml")
    assert f"winter ({' '.join(NEW)}), finished 3" in asked("add", "winter", *NEW, "--file", file)
    table = asked("--file", file)
    assert "none of these" in table
    assert " ".join(NEW) in table
    assert "…" not in table


def test_without_a_file_the_product_s_goals_are_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert " ".join(GOAL) in asked()
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_is_named_before_the_command_is_that_of_the_command(tmp_path: Path) -> None:
    file = str(tmp_path / "goals.yaml")
    assert f"finished 3, in {file}" in " ".join(asked("--file", file, "add", "winter", *NEW).split())


def test_a_goal_with_too_few_parts_is_told_how_many_there_are(tmp_path: Path) -> None:
    answer = CliRunner().invoke(goals_app, ["--file", str(tmp_path / "goals.yaml"), "add", "short", *NEW[1:]])
    assert "goal short lists 5 parts for 6 positions" in str(answer.exception)
