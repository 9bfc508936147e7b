"""A shift read back from its log: brackets, who placed what, waits by reason, OEE."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from bracket_cell.commands.main import main
from bracket_cell.log.read.reader import read_log
from bracket_cell.log.report.report import report_html
from bracket_cell.log.report.shift import Shift, shift_from, shift_of
from bracket_cell.production.effectiveness import effectiveness_of
from bracket_cell.recording.parts import part_path
from bracket_cell.recording.recorder import Heading, McapRecorder
from bracket_cell.settings import LogSettings
from bracket_cell.watching.observer import Outcome
from bracket_ground.interfaces.command import Command, Display
from bracket_ground.interfaces.faults import Action, SafetyDecision
from bracket_ground.interfaces.operator import Question
from tests.cell.log.report.outline import outline_of
from tests.cell.running.test_brackets import BEGIN, END, NEXT, Note, record

HELD = SafetyDecision(Action.HOLD, 0.0, (("hand_too_near", "the hand is too near"),))
ASKED = Display(questions=(Question(1, "help", "there is no safety valve (o3) in the tray"),))
SECOND_END: tuple[Note, ...] = (
    ("bracket", {"number": 2, "edge": "end", "finished": True, "placed": {}, "goal": "g1"}),
)
JUDGED = [{"number": 1, "goal": "g0", "correct": True}, {"number": 2, "goal": "g1", "correct": False}]


@pytest.fixture
def shift(tmp_path: Path) -> Shift:
    path = tmp_path / "shift.mcap"
    recorder = McapRecorder(
        path, LogSettings(camera_frames=False), Heading({}, {}), result=lambda: {"brackets": JUDGED}
    )
    placed: tuple[Note, ...] = (
        ("belief", {"edge": ["o1", "p1"], "source": "action"}),
        ("belief", {"edge": ["o2", "p2"], "source": "robot"}),
    )
    end: tuple[Note, ...] = (("bracket", {**END[0][1], "placed": {}, "goal": "g0"}),)
    for tick_record in (
        record(0),
        record(1, BEGIN),
        replace(record(2), judgement=HELD),
        replace(record(3), command=Command(display=ASKED)),
        record(5, (("help", {"text": "o3, please"}),)),
        replace(record(6), command=Command(display=Display())),
        record(7, placed),
        record(11, end),
        record(12, (("bracket", {**NEXT[0][1], "order": "A-7"}),)),
        record(16, SECOND_END),
    ):
        recorder.tick(replace(tick_record, observation=replace(tick_record.observation, tick=recorder._tick)))
    recorder.close(Outcome("finished", "", 10, 0, 16.0, 0.1))
    log = read_log(path)
    told = shift_of(shift_from(log.ticks, lambda: log.metadata, lambda: log.result).book)
    page = report_html(log)
    outline_of(page)
    assert "OEE" in page
    assert "there is no safety valve" in page
    assert "not as A-7 wants it" in page
    return told


def test_brackets_have_their_times_hands_questions_and_verdicts(shift: Shift) -> None:
    first, second = shift.brackets
    assert (first.length_s, second.length_s) == (10.0, 4.0)
    assert (first.robot, first.person, first.questions) == (1, 1, ["o3, please"])
    assert (first.variant, first.correct, second.correct) == ("g0", True, False)
    assert (first.ordered, second.ordered, second.order) == ("", "A-7", "")
    assert (first.misses_order, second.misses_order) == (False, True)


def test_waits_are_summed_by_their_reason(shift: Shift) -> None:
    assert dict(shift.waits_s) == {"the hand is too near": 1.0, "there is no safety valve (o3) in the tray": 3.0}


def test_a_question_beside_the_work_is_no_wait_and_what_stays_wrong_is_told(tmp_path: Path) -> None:
    path = tmp_path / "mend.mcap"
    recorder = McapRecorder(path, LogSettings(camera_frames=False), Heading({}, {}))
    mend = Display(questions=(Question(1, "mend", "p2 holds the safety valve (o3)", positions=("p2",)),))
    end: tuple[Note, ...] = (("bracket", {**END[0][1], "placed": {}, "goal": None, "known_wrong": ["p2"]}),)
    for tick_record in (record(0), record(1, BEGIN), replace(record(2), command=Command(display=mend)), record(9, end)):
        recorder.tick(replace(tick_record, observation=replace(tick_record.observation, tick=recorder._tick)))
    recorder.close(Outcome("finished", "", 4, 0, 9.0, 0.1))
    log = read_log(path)
    told = shift_of(shift_from(log.ticks, lambda: log.metadata, lambda: log.result).book)
    assert (told.losses, told.brackets[0].known_wrong) == ([], ["p2"])
    assert "known to be wrong: p2" in report_html(read_log(path))


def test_effectiveness_is_the_standards_and_what_is_not_known_is_not_made_up(shift: Shift) -> None:
    """16 s planned, 14 of them in brackets, 4 of those waited; ideal times are not configured."""
    whole = shift.whole
    assert whole.availability == pytest.approx((14 - 4) / 16)
    assert (whole.effectiveness, whole.oee) == (None, None)
    assert (whole.quality, whole.inspected, whole.good) == (0.5, 2, 1)
    runs = [replace(run, ideal_s={"g0": 3.0, "g1": 2.0}, planned_day_s=40.0) for run in shift.runs]
    known = effectiveness_of(runs, shift.brackets)
    assert known.availability == pytest.approx(10 / 40)
    assert known.effectiveness == pytest.approx((3 + 2) / 10)
    assert known.oee == pytest.approx(0.25 * 0.5 * 0.5)
    assert known.per_hour == pytest.approx(2 * 3600 / 40)
    nobody = effectiveness_of(runs, [replace(bracket, correct=None) for bracket in shift.brackets])
    assert (nobody.quality, nobody.oee) == (None, None)


def test_a_long_shift_is_told_part_by_part(tmp_path: Path) -> None:
    path = tmp_path / "long.mcap"
    recorder = McapRecorder(
        path, LogSettings(camera_frames=False, rotate_s=600), Heading({}, {}), result=lambda: {"brackets": JUDGED}
    )
    ends: tuple[Note, ...] = (("bracket", {**END[0][1], "placed": {}, "goal": "g0"}),)
    notes = {1: BEGIN, 7: ends, 8: NEXT, 11: SECOND_END}
    for number in range(12):
        one = record(number, notes.get(number, ()))
        recorder.tick(replace(one, observation=replace(one.observation, tick=number, time_s=number * 300.0)))
        recorder.settle()
    recorder.close(Outcome("finished", "", 12, 0, 3300.0, 0.1))
    page = tmp_path / "long.html"
    assert main(["report", str(path)]) == 0
    told = page.read_text()
    assert "OEE" in told
    assert f"cell report {part_path(path, 2)}" in told
    assert "What the nodes did" not in told
    assert main(["report", str(path)]) == 0, "its own page may be written anew"
    page.write_text("<html>mine</html>")
    assert main(["report", str(path)]) == 2
    assert page.read_text() == "<html>mine</html>"


def test_questions_are_in_a_table_with_what_was_expected(tmp_path: Path) -> None:
    path, costs = tmp_path / "asked.mcap", {"act_s": 37.5, "wait_s": 31.0, "after_one_s": 4.0, "ask_s": 30.0}
    recorder = McapRecorder(path, LogSettings(camera_frames=False), Heading({}, {}))
    unsure: tuple[Note, ...] = (("help", {"text": "which?", "belief": {"g0": 0.125, "g1": 0.875}, "costs": costs}),)
    recorder.tick(record(0, BEGIN))
    recorder.tick(replace(record(1, unsure), observation=replace(record(1).observation, tick=1)))
    recorder.close(Outcome("finished", "", 2, 0, 1.0, 0.1))
    page = report_html(read_log(path))
    [row] = [line for line in page.splitlines() if "which?" in line and "g1 (0.875)" in line]
    assert [f">{cost_s:.1f} s<" in row for cost_s in costs.values()] == [True] * 4
    assert '<td class="n">1</td>' in row, "the bracket's number"


def test_a_log_without_brackets_is_no_shift(tmp_path: Path) -> None:
    path = tmp_path / "one.mcap"
    recorder = McapRecorder(path, LogSettings(camera_frames=False), Heading({}, {}))
    recorder.tick(record(0))
    recorder.close(Outcome("finished", "", 1, 0, 1.0, 0.1))
    assert shift_from(read_log(path).ticks, dict, dict).rows == []
    assert "OEE" not in report_html(read_log(path))
