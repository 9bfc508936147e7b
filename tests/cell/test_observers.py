"""Progress, contact sheet and statistics show what happened."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from rich.console import Console

from bracket_cell.log.report.contact_sheet import (
    CAPTION_PX,
    COLUMNS,
    THUMBNAIL_PX,
    Shot,
    compose,
    write_sheet,
)
from bracket_cell.recording.recorder import Heading, McapRecorder
from bracket_cell.settings import LogSettings
from bracket_cell.viewing.moments import MOST_FRAMES, MOST_KEPT, Moments
from bracket_cell.viewing.progress import LiveProgress
from bracket_cell.watching.observer import Outcome
from bracket_cell.watching.statistics import RunStatistics
from bracket_ground.interfaces.command import Command, Display
from bracket_ground.interfaces.operator import Answer, Question
from bracket_ground.interfaces.perception import Action
from tests.cell.fakes import frame, idle_view
from tests.cell.recording.test_recorder import record

OUTCOME = Outcome("finished", "the tree succeeded", 3, 0, 1.0, 0.5)
DISPLAY = Display(
    guidance={"o1": ("p2",), "o2": ()}, goal_belief={"g0": 0.25, "g1": 0.75}, message="waiting", help_request="place o1"
)


def shot(number: int) -> Shot:
    """A thumbnail of one grey level."""
    return Shot(np.full((THUMBNAIL_PX[1], THUMBNAIL_PX[0], 3), number, np.uint8), float(number), f"shot {number}")


def test_plain_progress_tells_each_change_once() -> None:
    text = io.StringIO()
    progress = LiveProgress(Console(file=text, width=200), 0.04)
    for tick in range(3):
        progress.tick(record(tick, Command(display=DISPLAY)))
    progress.close(OUTCOME)
    lines = [line.split(maxsplit=3)[2:] for line in text.getvalue().splitlines()]
    assert lines == [
        ["hand", "no hand in view"],
        ["goal", "g1 0.75, g0 0.25"],
        ["guidance", "The o1 goes into p2. No o2 is left to place"],
        ["robot", "waiting"],
        ["help", "place o1"],
    ]


def test_what_a_placement_needs_may_fall_without_a_line_for_each_step() -> None:
    text = io.StringIO()
    progress = LiveProgress(Console(file=text, width=200), 0.04)
    for tick, words in enumerate(("0.50 < 0.953", "0.50 < 0.952", "0.50 < 0.951", "0.60 < 0.951", "0.60")):
        shown = replace(DISPLAY, message=f"holding o1; o1 at p5 has probability {words}")
        progress.tick(record(tick, Command(display=shown)))
    ends = [line.rpartition("probability ")[2] for line in text.getvalue().splitlines() if "holding" in line]
    assert ends == ["0.50 < 0.953", "0.60 < 0.951"]


def test_a_terminal_shows_a_panel() -> None:
    text = io.StringIO()
    progress = LiveProgress(Console(file=text, width=100, force_terminal=True), 0.04)
    progress.tick(record(0, Command(display=DISPLAY)))
    progress.close(OUTCOME)
    for words in ("ticks/s", "g1 0.75", "The o1 goes into p2", "waiting", "place o1"):
        assert words in text.getvalue()


def test_a_terminal_shows_a_question_with_its_answers() -> None:
    """In the panel "[g0 | g1]" was taken for a style, and nobody could know what to answer."""
    question = Question(3, "goal", "I am not sure", todo="say which", answers=(Answer("g0", "g0"), Answer("g1", "g1")))
    text = io.StringIO()
    progress = LiveProgress(Console(file=text, width=100, force_terminal=True), 0.04)
    progress.tick(record(0, Command(display=replace(DISPLAY, questions=(question,), message="at [p1]"))))
    progress.close(OUTCOME)
    assert "3: I am not sure; say which [g0 | g1]" in text.getvalue()
    assert "at [p1]" in text.getvalue()


def sheet_of(folder: Path, moments: Moments, *frames_s: float) -> Path | None:
    """The sheet of a log with overhead frames at these times."""
    recorder = McapRecorder(folder / "log.mcap", LogSettings(), Heading())
    for number, time_s in enumerate(frames_s):
        recorder.frame(frame(number, time_s))
    recorder.close(OUTCOME)
    path = folder / "sheet.png"
    return path if write_sheet(folder / "log.mcap", moments, "done", path) else None


def test_the_sheet_shows_begin_screw_help_and_end(tmp_path: Path) -> None:
    moments, seen = Moments(), record(0)
    screwing = replace(idle_view(frame(4)), action=Action("screw", 1.0))
    moments.tick(seen)
    moments.tick(
        replace(seen, observation=replace(seen.observation, bench=screwing), notes=(("help", {"text": "o1"}),))
    )
    path = sheet_of(tmp_path, moments, 0.0, 0.2, 0.4)
    image = cv2.imread(str(path))
    assert image is not None
    assert image.shape == (THUMBNAIL_PX[1] + CAPTION_PX, 4 * THUMBNAIL_PX[0], 3)


def test_a_run_without_frames_makes_no_sheet(tmp_path: Path) -> None:
    assert sheet_of(tmp_path, Moments()) is None
    assert not (tmp_path / "sheet.png").exists()


def test_a_shift_keeps_few_moments_and_spreads_them() -> None:
    moments = Moments()
    for tick in range(20_000):
        moments.see(record(tick).observation, (("help", {"text": f"part {tick}"}),))
    chosen = moments.chosen()
    assert len(moments._kept) <= MOST_KEPT
    assert len(chosen) == MOST_FRAMES - 2
    assert chosen[0].caption == "help: part 0"
    assert np.diff([int(moment.caption.split()[-1]) for moment in chosen]).max() < 20_000 / 20


def test_of_too_many_shots_first_and_last_are_kept() -> None:
    sheet = compose([shot(number) for number in range(100)])
    rows = MOST_FRAMES // COLUMNS
    assert sheet.shape == (rows * (THUMBNAIL_PX[1] + CAPTION_PX), COLUMNS * THUMBNAIL_PX[0], 3)
    assert (sheet[0, 0, 0], sheet[-CAPTION_PX - 1, -1, 0]) == (0, 99)


def test_the_tally_keeps_the_last_belief_and_counts_calls_for_help() -> None:
    statistics = RunStatistics()
    statistics.tick(record(0, Command(display=DISPLAY)))
    statistics.tick(record(1, Command(display=Display(message="nothing known"))))
    statistics.tick(replace(record(2), notes=(("help", {"text": "o1"}), ("plan", {}), ("help", {"text": "o2"}))))
    statistics.tick(replace(record(3), notes=(("verdict", {"decision": "refused"}), ("verdict", {"decision": "act"}))))
    assert (statistics.inferred_goal, statistics.help_requests, statistics.plans_refused) == ("g1", 2, 1)


def test_without_a_belief_no_goal_is_inferred() -> None:
    assert RunStatistics().inferred_goal is None
