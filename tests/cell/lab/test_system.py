"""Whole assemblies are counted right, and what was run is not run again."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from bracket_cell.commands.main import main
from bracket_lab.evaluations import system
from bracket_lab.evaluations.system import table_1

ROW = {"end": "finished", "correct": True, "placed": 4, "told": 4, "told_right": 4, "allowed": 2, "allowed_right": 2}


def row(goals: int, seed: int, **changes: Any) -> dict[str, Any]:
    return {"goals": goals, "seed": seed, **ROW, "contradictions": 0, **changes}


def test_the_table_counts_by_number_of_goals() -> None:
    found = table_1([row(3, 1), row(3, 2, correct=False, end="timeout", told=6, told_right=3), row(1, 1)])
    assert list(found) == ["1", "3"]
    assert (found["3"]["AD"]["share"], found["3"]["AD"]["n"]) == (7 / 8, 8)
    assert found["3"]["false_per_100"] == 37.5
    assert found["3"]["SC"]["share"] == 0.5
    assert found["3"]["not_finished"] == 1
    assert "SC .918" in found["3"]["paper"]
    assert found["1"]["paper"].startswith("AD .9")


def test_assemblies_in_which_the_person_errs_are_told_apart() -> None:
    found = table_1([row(3, 1, lapses=0), row(3, 2, lapses=2), row(3, 3, lapses=1, correct=False), row(1, 1)])
    assert (found["3"]["corrected"]["share"], found["3"]["corrected"]["n"]) == (0.5, 2)
    assert "corrected" not in found["1"]  # not counted is not zero


def test_what_a_file_holds_is_not_run_again_and_an_interrupted_table_is_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[list[tuple[int, int]]] = []

    def evaluate(_: object, __: object, ___: object, goals: int, seed: int, **____: object) -> Any:
        if len(asked[-1]) == 3:
            raise KeyboardInterrupt
        asked[-1].append((goals, seed))
        return row(goals, seed)

    monkeypatch.setattr(system, "evaluate_system", evaluate)
    out = tmp_path / "rows.jsonl"
    words = [
        "lab",
        "eval",
        "system",
        "--perception",
        "learned",
        "--look",
        "nominal",
        "--goals",
        "1",
        "--goals",
        "3",
        "--seeds",
        "900000:900003",
        "--out",
        str(out),
    ]
    for status in (1, 0):
        asked.append([])
        assert main([*words, "--json"]) == status
    assert asked[1] == [(3, 900_001), (1, 900_002), (3, 900_002)]
    found = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert found["goals"]["3"]["assemblies"] == 3
    assert main([*words, "--cameras", "believed"]) == 2  # rows of other cameras belong into another file
    assert len(asked) == 2
    out.write_text("{}\n")
    assert main(words) == 2


def test_an_assembly_that_a_signal_ended_is_no_row_and_the_last_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The controller hears the signal, so none is raised here."""
    ends = iter(["finished", "interrupted", "finished"])
    monkeypatch.setattr(system, "evaluate_system", lambda *_, **__: row(3, 900_000) | {"end": next(ends)})
    out = tmp_path / "rows.jsonl"
    assert main(["lab", "eval", "system", "--look", "nominal", "--seeds", "900000:900003", "--out", str(out)]) == 1
    assert '"finished"' in out.read_text()
    assert '"interrupted"' not in out.read_text()
    assert next(ends) == "finished"


def test_cameras_and_detectors_must_be_legal() -> None:
    assert main(["lab", "eval", "system", "--cameras", "good"]) == 2
    assert main(["lab", "eval", "system", "--perception", "good"]) == 2
