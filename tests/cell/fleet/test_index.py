"""The table of a folder's runs: a row for each log, questions in SQL, why trees failed."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from cell.commands.main import main
from cell.fleet.index import FAILURES, add_run, ask, refresh
from cell.interfaces.errors import InputError
from cell.log.reading.heading import run_row
from cell.log.reading.reader import Log
from cell.observer import Outcome
from cell.recording.recorder import Heading, McapRecorder
from cell.settings import LogSettings


def failed(path: Path, seed: int, failure: str) -> None:
    """A log of a tree that failed."""
    heading = Heading({"run_id": f"id{seed}", "seed": str(seed), "goal": "random", "started_utc": f"2026-11-0{seed}"})
    recorder = McapRecorder(path, LogSettings(), heading, result=lambda: {"last_failure": failure, "correct": False})
    recorder.close(Outcome("failed", "the tree failed", 1, 0, 12.5, 0.5))


def test_a_row_says_who_when_and_what_came_of_it(commission_log: Log) -> None:
    row = run_row(commission_log.path)
    assert row["run_id"] == commission_log.metadata["run_id"]
    assert (row["end"], row["ticks"]) == (commission_log.outcome["end"], int(commission_log.outcome["ticks"]))
    assert row["version_mujoco"] == commission_log.metadata["version.mujoco"]
    assert row["placements"] == json.loads(commission_log.result["placements"])


def test_a_killed_run_has_a_row_too(commission_log: Log, tmp_path: Path) -> None:
    path = tmp_path / "killed.mcap"
    path.write_bytes(commission_log.path.read_bytes()[:-5000])
    row = run_row(path)
    assert row["run_id"] == commission_log.metadata["run_id"]
    assert "not closed" in row["unfinished"]


def test_runs_are_found_by_any_question(commission_log: Log, tmp_path: Path) -> None:
    shutil.copy(commission_log.path, tmp_path / "a.mcap")
    failed(tmp_path / "b.mcap", 2, "FindPart: no o9 in the tray (16 times)")
    failed(tmp_path / "c.mcap", 3, "FindPart: no o9 in the tray (16 times)")
    (tmp_path / "d.mcap").write_text("no log")
    assert [problem.partition(": ")[2] for problem in refresh(tmp_path)] == [
        "is no MCAP file: it does not begin as one"
    ]
    assert ask(tmp_path, "select seed from runs where \"end\" = 'failed' order by seed") == (["seed"], [(2,), (3,)])
    [(leaf, cause, count, example)] = ask(tmp_path, FAILURES)[1]
    assert (leaf, count, Path(example).name) == ("FindPart", 2, "b.mcap")
    assert "no o9" in cause
    failed(tmp_path / "e.mcap", 4, "x")
    add_run(tmp_path / "e.mcap")
    assert ask(tmp_path, "select count(*) from runs")[1] == [(4,)]
    with pytest.raises(InputError, match="cannot be answered"):
        ask(tmp_path, "select nothing from nowhere")


def test_the_command_lists_searches_and_counts(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for seed in (1, 2):
        failed(tmp_path / f"{seed}.mcap", seed, "PickPart: nothing between the fingers")
    assert main(["log", "list", str(tmp_path), "--sql", "select count(*) as runs from runs", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"runs": 2}
    assert main(["log", "list", str(tmp_path), "--failures"]) == 0
    assert "PickPart" in capsys.readouterr().out
    assert main(["log", "list", str(tmp_path), "--statistics", "end"]) == 0
    assert "end failed: 0 of 2 right, 0.000 (95 %: 0.000 - 0.658)" in capsys.readouterr().out
    assert main(["log", "list", str(tmp_path), "--statistics", "nothing"]) == 2
    assert main(["log", "list", str(tmp_path / "none")]) == 2
