"""Why a run failed stands in the log's outcome, and everything that tells of a log says it in the same words."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from bracket_cell.commands.main import main
from bracket_cell.log.read.reader import Log, read_log
from bracket_cell.log.replay.why import why_at
from bracket_cell.log.report.query import info, ticks, why_of
from bracket_cell.log.report.report import report_html
from bracket_cell.log.report.summary import node_rows, with_cause
from bracket_cell.log.report.text import info_lines, tick_lines, why_lines
from bracket_cell.recording.recorder import Heading, McapRecorder
from bracket_cell.recording.schemas import TICKED
from bracket_cell.settings import LogSettings
from bracket_cell.watching.observer import Outcome
from bracket_ground.errors import LogError
from btxml.engine.why import Reason, Step
from tests.cell.recording.test_recorder import record

ROOT = Step("job", 1, "Sequence", "job", "commission.xml", 4, "FAILURE")
SHORT = Step("job/ready", 990, "ScriptCondition", "ready?", "commission.xml", 9, "FAILURE", "'n > 3' is false, n = 2",
             "if 'n > 3' were true")  # fmt: skip
WHY = Reason((ROOT, SHORT))
SENTENCE = "ScriptCondition 'ready?' (commission.xml:9): 'n > 3' is false, n = 2"


@pytest.fixture
def failed_log(commission_log: Log) -> Log:
    """The same run, whose tree failed in its last tick by a node that nobody saw running."""
    ran = list(commission_log.ticks)
    last = max(place for place, tick in enumerate(ran) if tick.status != "STOPPING")
    ran[last] = replace(ran[last], status="FAILURE")
    outcome = {**commission_log.outcome, "end": "failed", "reason": "the tree failed", "cause": str(WHY),
               "why": json.dumps(WHY.plain())}  # fmt: skip
    return replace(commission_log, ticks=tuple(ran), outcome=outcome)


def test_info_and_ticks_tell_the_cause(failed_log: Log) -> None:
    assert (why_of(failed_log) or {})["text"] == SENTENCE
    told = f"{SENTENCE}; otherwise if 'n > 3' were true"
    assert f"  why       {told}" in list(info_lines(info(failed_log)))
    last = [tick for tick in ticks(failed_log) if tick["status"] == "FAILURE"]
    assert f"  why        {told}" in list(tick_lines(last[0]))


def test_the_report_begins_with_the_cause_and_marks_the_node_however_short_it_was(failed_log: Log) -> None:
    page = report_html(failed_log)
    first = page[page.index("<main>") :].split("</p>")[0]
    assert SENTENCE.replace("'", "&#39;").replace(">", "&gt;") in first
    assert '<text class="decided"' in page
    [marked] = [row for row in with_cause(node_rows(failed_log), failed_log, why_of(failed_log)) if row.decided]
    assert (marked.uid, marked.runs[-1].ending, marked.runs[-1].feedback) == (990, "decided", SHORT.words)


def test_a_log_that_does_not_say_has_no_cause(commission_log: Log) -> None:
    assert why_of(commission_log) is None
    assert 'class="why' not in report_html(commission_log)


def test_a_moment_of_a_log_is_explained_from_the_root(commission_log: Log) -> None:
    middle = commission_log.ticks[len(commission_log.ticks) // 2]
    told = why_at(commission_log.parts, middle.time_s)
    assert (told["tick"], told["time_s"]) == (middle.number, pytest.approx(middle.time_s))
    assert told["tree"]["steps"][0]["path"] == commission_log.ticks[0].changes[0].path
    lines = list(why_lines(told))
    assert told["tree"]["words"] in lines[0]
    assert any(line.startswith("  compared") for line in lines)


def test_a_time_as_it_is_printed_finds_its_tick(commission_log: Log, capsys: pytest.CaptureFixture[str]) -> None:
    asked = [tick for tick in commission_log.ticks if tick.status in TICKED][3::97]
    for tick in asked:
        assert main(["log", "why", str(commission_log.path), "--at", f"{tick.time_s:.2f}", "--json"]) == 0
        assert json.loads(capsys.readouterr().out)["tick"] == tick.number


def test_a_log_that_noted_no_reasons_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = tmp_path / "log.mcap"
    recorder = McapRecorder(log, LogSettings(camera_frames=False), Heading({}, {}))
    recorder.tick(record(0))
    recorder.close(Outcome("finished", "", 1, 0, 0.0, 0.1))
    assert main(["log", "why", str(log)]) == 2
    assert "holds no record of reasons" in capsys.readouterr().err


def test_a_time_before_the_log_begins_is_refused(commission_log: Log, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["log", "why", str(commission_log.path), "--at", "-1"]) == 2
    assert "holds no tick of the tree up to the time" in capsys.readouterr().err


@pytest.mark.parametrize("told", ["{", "[1]", '"x"', '{"text": "x"}'])
def test_a_reason_that_is_none_is_one_clear_error(told: str, tmp_path: Path) -> None:
    log = tmp_path / "log.mcap"
    recorder = McapRecorder(log, LogSettings(camera_frames=False), Heading({}, {}))
    recorder.tick(record(0))
    recorder.close(Outcome("finished", "", 1, 0, 0.0, 0.1))
    wrong = replace(read_log(log), outcome={"why": told})
    with pytest.raises(LogError, match="why in its metadata does not hold what it should"):
        why_of(wrong)
