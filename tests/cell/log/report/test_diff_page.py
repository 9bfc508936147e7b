"""Two runs on one page: why they differ stands first, and the page says what the comparison says."""

from __future__ import annotations

import dataclasses
import re
import shutil
from pathlib import Path
from typing import Any

import pytest

from bracket_cell.commands.main import main
from bracket_cell.log.read.reader import Log
from bracket_cell.log.replay.explain import causes, changed_files
from bracket_cell.log.report import query
from bracket_cell.log.report.diff_page import diff_html
from tests.cell.log.report.outline import outline_of

NAMES = ("one.mcap", "other.mcap")


def page(one: Log, other: Log) -> str:
    html = diff_html(one, other, query.diff(one, other), NAMES, said(one, other))
    outline_of(html)
    return html


def said(one: Log, other: Log) -> list[str]:
    return causes(query.diff(one, other), changed_files(one, other))


def test_runs_that_are_the_same_say_so(assembly_log: Log) -> None:
    told = page(assembly_log, assembly_log)
    assert "saw and decided the same in every tick" in told
    assert "Nodes that ran at other times" not in told


def test_another_tree_is_named_before_all_else(assembly_log: Log) -> None:
    files = dict(assembly_log.attachments)
    files["tree/assemble.xml"] = files["tree/assemble.xml"].replace(b"num_attempts", b"num_attempts ")
    place = next(at for at, tick in enumerate(assembly_log.ticks) if tick.command)
    ticks = list(assembly_log.ticks)
    ticks[place] = dataclasses.replace(ticks[place], command=None)
    other = dataclasses.replace(assembly_log, attachments=files, ticks=tuple(ticks))
    told = page(assembly_log, other)
    assert "no record: no noted comparison answers otherwise up to there" in told
    assert "tree/assemble.xml" in told
    assert told.index("Why they differ") < told.index("Recorded with") < told.index("What came of it")
    assert told.count("data:image/jpeg;base64,") == 2


def test_outcomes_are_told_in_few_digits_and_without_brackets(assembly_log: Log) -> None:
    failed: Any = {
        "end": "failed",
        "cause": "time is up",
        "why": {"text": "time is up"},
        "wall_time_s": 85.58608434299822,
    }
    told = page(assembly_log, dataclasses.replace(assembly_log, outcome=failed))
    assert "85.59" in told
    assert "85.586" not in told
    assert "&#34;text&#34;" not in told
    assert '{"text"' not in told


@pytest.mark.slow
def test_other_seeds_are_said_to_have_seen_other_things(assembly_log: Log, tray_log: Log) -> None:
    assert re.fullmatch(r"tick \d+, .* is seen otherwise; changed: .*seed: 1 -> 3.*", said(assembly_log, tray_log)[0])


def test_the_command_writes_it(assembly_log: Log, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    copy = shutil.copy(assembly_log.path, tmp_path / "copy.mcap")
    target = tmp_path / "diff.html"
    assert main(["log", "diff", str(assembly_log.path), str(copy), "--html", str(target)]) == 0
    assert "identical" in capsys.readouterr().out
    assert "<script" not in target.read_text()
    assert main(["log", "diff", str(assembly_log.path), str(copy), "--html", str(tmp_path / "no" / "d.html")]) == 2
    assert "cannot be written" in capsys.readouterr().err
