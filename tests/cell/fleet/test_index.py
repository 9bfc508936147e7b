"""The table of a folder's runs: a row for each log, questions in SQL, why trees failed."""

from __future__ import annotations

import json
import os
import shutil
import sys
from pathlib import Path

import pyarrow as arrow
import pyarrow.parquet
import pytest

from bracket_cell.commands.main import main
from bracket_cell.fleet.index import FAILURES, ask, refresh, summaries, summary_lines
from bracket_cell.fleet.night import clip
from bracket_cell.fleet.run_row import run_row
from bracket_cell.fleet.table import read_table, write_table
from bracket_cell.log.read.mcap_file import metadata_of, read_mcap
from bracket_cell.log.read.reader import Log
from bracket_cell.recording.recorder import Heading, McapRecorder
from bracket_cell.settings import LogSettings
from bracket_cell.watching.observer import Outcome
from bracket_ground.errors import InputError
from btxml.engine.why import Reason, Step
from tests.processes import finished


def failed(path: Path, seed: int, failure: str) -> None:
    """A log of a tree that failed."""
    heading = Heading({"run_id": f"id{seed}", "seed": str(seed), "goal": "random", "started_utc": f"2026-11-0{seed}"})
    recorder = McapRecorder(path, LogSettings(), heading, result=lambda: {"correct": False})
    node, _, words = failure.partition(": ")
    why = Reason((Step(f"M/{node}", 1, node, node, "m.xml", 3, "FAILURE", words),))
    recorder.close(Outcome("failed", "the tree failed", 1, 0, 12.5, 0.5, why=why))


@pytest.mark.long
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
        "is not an MCAP file: it does not begin like one"
    ]
    assert ask(tmp_path, "select seed from runs where \"end\" = 'failed' order by seed") == (["seed"], [(2,), (3,)])
    names, rows = ask(tmp_path, FAILURES)
    first = dict(zip(names, rows[0], strict=True))
    assert [Path(row[0]).name for row in rows] == ["b.mcap", "c.mcap"]
    assert (first["failed_leaf"], first["end"], first["state"], first["failed_s"]) == ("FindPart", "failed", "start", 0)
    assert "no o9" in first["cause"]
    failed(tmp_path / "e.mcap", 4, "x")
    refresh(tmp_path)
    assert ask(tmp_path, "select count(*) from runs")[1] == [(4,)]
    with pytest.raises(InputError, match="cannot be answered"):
        ask(tmp_path, "select nothing from nowhere")


@pytest.mark.parametrize(
    "sql",
    [
        "copy (select 1) to '{file}'",
        "select 1; copy runs to '{file}'",
        "copy runs to '{rows}/new.parquet'",
        "explain analyze copy runs to '{rows}/new.parquet'",
        "export database '{folder}/all'",
        "attach '{folder}/new.db'",
        "create table copied as select * from runs",
        "set enable_external_access = true",
        "select * from read_text('{file}')",
    ],
)
def test_a_question_only_reads(tmp_path: Path, sql: str) -> None:
    """`copy ... to 'README.md'` wrote over that file."""
    folder = tmp_path / "some runs'"
    folder.mkdir()
    failed(folder / "1.mcap", 1, "x")
    refresh(folder)
    file = tmp_path / "README.md"
    file.write_text("mine")
    before = sorted(tmp_path.rglob("*"))
    quoted = str(folder).replace("'", "''")
    with pytest.raises(InputError, match="cannot be answered"):
        ask(folder, sql.format(file=file, folder=quoted, rows=f"{quoted}/rows"))
    assert (file.read_text(), sorted(tmp_path.rglob("*"))) == ("mine", before)


def test_questions_may_be_asked_in_several_ways(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    failed(tmp_path / "1.mcap", 1, "x")
    refresh(tmp_path)
    monkeypatch.chdir(tmp_path)
    for sql in (
        "from runs",
        "describe runs",
        "summarize runs",
        "with a as (select seed from runs) select * from a",
        'pivot runs on "end" using count(*)',
        "select 1; select seed from runs",
        "show tables",
    ):
        assert ask(Path(), sql)[1], sql


def test_the_command_lists_searches_and_counts(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for seed in (1, 2):
        failed(tmp_path / f"{seed}.mcap", seed, "PickPart: nothing between the fingers")
    assert main(["log", "list", str(tmp_path), "--sql", "select count(*) as runs from runs", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"runs": 2}
    assert main(["log", "list", str(tmp_path), "--failures"]) == 0
    assert capsys.readouterr().out.count("PickPart (m.xml:3)") == 2
    page = tmp_path / "night.html"
    assert main(["log", "list", str(tmp_path), "--failures", "--html", str(page)]) == 0
    assert "2 failed" in capsys.readouterr().out
    assert page.read_text().count("PickPart (m.xml:3): nothing between the fingers") == 2
    assert main(["log", "list", str(tmp_path), "--html", str(page)]) == 2
    assert "--html goes with --failures" in capsys.readouterr().err
    assert main(["log", "list", str(tmp_path), "--statistics", "end"]) == 0
    assert "end failed: 2 runs, 0 right, 2 wrong, 0 not known; 0.000 (95 %: 0.000 - 0.658)" in capsys.readouterr().out
    assert main(["log", "list", str(tmp_path), "--statistics", "nothing"]) == 2
    assert main(["log", "list", str(tmp_path / "none")]) == 2


def test_a_list_that_no_terminal_shows_is_a_line_a_row(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Rows were broken after 80 letters, and "[g1]" in a text was taken for a style."""
    failed(tmp_path / "1.mcap", 1, f"PickPart: no [g1] here [/b] {'x' * 200}")
    assert main(["log", "list", str(tmp_path), "--sql", "select cause, null, 7 as n from runs"]) == 0
    head, line = capsys.readouterr().out.splitlines()
    assert head.split("\t")[::2] == ["cause", "n"]
    assert line.split("\t") == [f"PickPart (m.xml:3): no [g1] here [/b] {'x' * 200}", "", "7"]


def test_statistics_are_told_in_json_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for seed in (1, 2):
        failed(tmp_path / f"{seed}.mcap", seed, "PickPart: x")
    assert main(["log", "list", str(tmp_path), "--statistics", "seed", "--where", "seed > 1", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["seed"], told["runs"], told["right"], told["share"], told["sim_time_s"]) == ("2", 1, 0, 0.0, 12.5)


@pytest.mark.parametrize(
    "words", [["--failures", "--sql", "x"], ["--failures", "--where", "y"], ["--sql", "x", "--where", "y"]]
)
def test_no_question_is_passed_over(tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str]) -> None:
    failed(tmp_path / "1.mcap", 1, "PickPart: x")
    assert main(["log", "list", str(tmp_path), *words]) == 2
    assert capsys.readouterr().out == ""


def test_a_question_leaves_no_word_about_the_program_that_answers(tmp_path: Path) -> None:
    """DuckDB's binding told of leaks in a page of lines, where what was imported was kept to the end."""
    failed(tmp_path / "1.mcap", 1, "PickPart: x")
    asked = finished([sys.executable, "-m", "bracket_cell", "log", "list", str(tmp_path), "--sql", "from runs"])
    assert (asked.returncode, asked.stderr) == (0, "")


def test_a_run_names_the_work_orders_of_its_brackets_and_null_where_there_was_none(tmp_path: Path) -> None:
    for name, orders in (("made", ("A-7", "A-7", "", "A-8")), ("none", ("",))):
        told = {"brackets": [{"number": number, "order": order} for number, order in enumerate(orders, 1)]}
        recorder = McapRecorder(tmp_path / f"{name}.mcap", LogSettings(), Heading({"run_id": name}), result=told.copy)
        recorder.close(Outcome("finished", "", 1, 0, 1.0, 1.0))
    refresh(tmp_path)
    assert ask(tmp_path, "select run_id, order_id from runs order by run_id")[1] == [
        ("made", "A-7, A-8"),
        ("none", None),
    ]


def test_one_log_without_a_head_changes_no_type_and_what_is_empty_is_null(tmp_path: Path) -> None:
    failed(tmp_path / "a.mcap", 2, "x")
    failed(tmp_path / "b.mcap", 12, "x")
    heading = Heading({"run_id": "bare"})
    McapRecorder(tmp_path / "bare.mcap", LogSettings(), heading).close(Outcome("finished", "", 1, 0, 1.0, 1.0))
    refresh(tmp_path)
    old = {"run_id": "old", "seed": "", "site": "", "correct": "true", "sim_time_s": 3}
    arrow.parquet.write_table(arrow.Table.from_pylist([old]), tmp_path / "rows" / "old.parquet")
    assert ask(tmp_path, "select count(*) from runs where seed < 10")[1] == [(1,)]
    assert ask(tmp_path, "select avg(seed) from runs")[1] == [(7.0,)]
    assert ask(tmp_path, "select correct, seed, site from runs where run_id = 'old'")[1] == [(True, None, None)]
    names, rows = ask(tmp_path, "select * from runs")
    told_by_end = {
        summary["end"]: summary for summary in summaries([dict(zip(names, row, strict=True)) for row in rows], "end")
    }
    told = told_by_end["finished"]
    assert (told["right"], told["wrong"], told["not_known"], told["share"]) == (0, 0, 1, None)
    assert "none is known" in summary_lines(told, "end")[0]


def test_the_row_of_a_log_that_grows_follows_it(commission_log: Log, tmp_path: Path) -> None:
    first, rest = tmp_path / "shift.0001.mcap", tmp_path / "shift.0002.mcap"
    shutil.copy(commission_log.path, first)
    refresh(tmp_path)
    assert ask(tmp_path, "select parts from runs")[1] == [(1,)]
    shutil.copy(commission_log.path, rest)
    os.utime(rest, ns=(first.stat().st_mtime_ns + 10**9,) * 2)
    refresh(tmp_path)
    assert ask(tmp_path, "select parts from runs")[1] == [(2,)]


def test_the_film_of_a_failure_shows_the_seconds_before(commission_log: Log) -> None:
    assert clip(commission_log.path, 3.0).startswith("data:image/webp;base64,")
    assert clip(commission_log.path, None) == ""


def test_many_logs_are_one_table(tmp_path: Path) -> None:
    for seed in range(1, 6):
        failed(tmp_path / f"{seed}.mcap", seed, "x")
    refresh(tmp_path)
    assert [path.name for path in (tmp_path / "rows").iterdir()] == ["all.parquet"]
    before = (tmp_path / "rows" / "all.parquet").stat().st_mtime_ns
    refresh(tmp_path)
    assert (tmp_path / "rows" / "all.parquet").stat().st_mtime_ns == before


def test_a_text_column_holds_texts_lists_and_nothing_where_it_is_empty(tmp_path: Path) -> None:
    rows: list[dict[str, object]] = [{"reason": "stuck"}, {"reason": ["a", 1]}, {"reason": ""}, {"seed": 3}]
    write_table(rows, tmp_path / "t.parquet")
    assert [row["reason"] for row in read_table(tmp_path / "t.parquet")] == ["stuck", '["a", 1]', None, None]


def test_the_index_and_the_whole_file_hold_the_same_metadata(commission_log: Log) -> None:
    assert metadata_of(commission_log.path) == read_mcap(commission_log.path).metadata
