"""No disk stops the cell: what a log does when the disk refuses, and when it takes bytes again."""

from __future__ import annotations

import errno
import os
from io import StringIO
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from bracket_cell.log.read.reader import read_log
from bracket_cell.recording import rotation
from bracket_cell.recording import sink as log_sink
from bracket_cell.recording.recorder import Heading, McapRecorder
from bracket_cell.recording.sink import LogSink
from bracket_cell.runs.options import RunOptions
from bracket_cell.runs.run import run
from bracket_cell.settings import LogSettings
from bracket_cell.viewing.progress import LiveProgress
from bracket_cell.watching.observer import Level, TickRecord
from bracket_ground.errors import InputError
from bracket_sim.worker.worker import Worker
from tests.cell.conftest import changed_configuration
from tests.cell.fakes import frame
from tests.cell.recording.test_recorder import OUTCOME, record


class Disk:
    """A pwrite that refuses while `error` is set, after taking half of what it was given."""

    def __init__(self) -> None:
        self.error: int | None = None
        self._pwrite = os.pwrite

    def pwrite(self, descriptor: int, data: Any, offset: int) -> int:
        error = self.error  # once: the log's thread writes while the test repairs the disk
        if error is None:
            return self._pwrite(descriptor, data, offset)
        self._pwrite(descriptor, data[: len(data) // 2], offset)
        raise OSError(error, os.strerror(error))


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> Disk:
    disk = Disk()
    monkeypatch.setattr(os, "pwrite", disk.pwrite)
    monkeypatch.setattr(log_sink, "RETRY_S", 0.001)
    monkeypatch.setattr(rotation, "PATIENCE_S", 10.0)  # a busy machine is no disk that refuses
    return disk


def recorded(path: Path, disk: Disk, error: int, back: bool, buffer_mb: float) -> tuple[McapRecorder, list[str]]:
    """A log of 40 ticks; the disk refuses from tick 10 on, and takes bytes again at tick 30 if it is `back`."""
    alarms: list[str] = []

    def alarm(_: float, level: Level, text: str) -> None:
        alarms.append(f"{level}: {text}")

    recorder = McapRecorder(path, LogSettings().model_copy(update={"buffer_mb": buffer_mb}), Heading(), alarm=alarm)
    for number in range(40):
        if number in (10, 30):
            disk.error = None if number == 30 and back else error
        recorder.frame(frame(number, number * 0.04))
        recorder.tick(record(number))
        recorder.settle()
    recorder.close(OUTCOME)
    return recorder, alarms


@pytest.mark.parametrize("error", [errno.ENOSPC, errno.EIO, errno.EROFS])
def test_a_disk_that_refuses_raises_one_alarm_and_the_rest_stays_readable(
    error: int, disk: Disk, tmp_path: Path
) -> None:
    recorder, alarms = recorded(tmp_path / "log.mcap", disk, error, back=False, buffer_mb=16)
    assert not recorder.complete
    assert [text for text in alarms if "the cell goes on" in text] == [
        f"error: the log cannot be written: {os.strerror(error)}; the cell goes on"
    ]
    assert "the log is not complete" in alarms[-1]
    log = read_log(tmp_path / "log.mcap")
    assert len(log.ticks) == 10
    assert log.unfinished


def test_a_disk_that_takes_bytes_again_completes_the_log(disk: Disk, tmp_path: Path) -> None:
    recorder, alarms = recorded(tmp_path / "log.mcap", disk, errno.ENOSPC, back=True, buffer_mb=16)
    assert recorder.complete
    assert alarms[0].startswith("error")
    log = read_log(tmp_path / "log.mcap")
    assert (len(log.ticks), log.unfinished) == (40, "")


def test_images_are_dropped_before_ticks_and_counted(disk: Disk, tmp_path: Path) -> None:
    recorder, _ = recorded(tmp_path / "log.mcap", disk, errno.ENOSPC, back=True, buffer_mb=0.055)
    assert recorder.dropped.frames > recorder.dropped.ticks == 0
    assert not recorder.complete
    assert len(read_log(tmp_path / "log.mcap").ticks) == 40


def test_memory_stays_bounded(disk: Disk, tmp_path: Path) -> None:
    recorder, _ = recorded(tmp_path / "log.mcap", disk, errno.ENOSPC, back=False, buffer_mb=0.01)
    assert recorder.dropped.ticks > 0
    assert f"{recorder.dropped.ticks} ticks dropped" in recorder.shortfall


def test_the_writer_may_go_back_before_the_hand_over(tmp_path: Path) -> None:
    sink = LogSink(tmp_path / "file")
    sink.write(b"abc")
    sink.hand_over()
    sink.settle(1.0)
    sink.write(b"____ef")
    assert sink.seek(3) == 3
    sink.write(b"1234")
    assert sink.seek(0, 2) == 9
    sink.close()
    assert (tmp_path / "file").read_bytes() == b"abc1234ef"


@pytest.mark.long
def test_the_person_at_the_bench_sees_the_alarm_and_the_cell_goes_on(
    disk: Disk, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A whole run in simulation on a disk that is full from its beginning to its 12th tick, and at its end."""
    panel: list[str] = []
    told = StringIO()
    monkeypatch.setattr(Worker, "alarm", lambda _, text: panel.append(text))
    recorded_tick = McapRecorder.tick

    def tick(self: McapRecorder, one: TickRecord) -> None:
        disk.error = None if 12 <= one.observation.tick < 20 else errno.ENOSPC
        recorded_tick(self, one)

    monkeypatch.setattr(McapRecorder, "tick", tick)
    configuration = changed_configuration(tmp_path, "max_duration_s: 300.0", "max_duration_s: 1.0")
    options = RunOptions(configuration=configuration, goal="g0", seed=1, log=tmp_path / "log.mcap")
    result = run(options, Console(file=told, width=300))
    assert result.outcome.end == "timeout"
    trouble = "the log cannot be written: No space left on device; the cell goes on"
    assert panel[:3] == [trouble, "", trouble]
    assert trouble in told.getvalue()
    assert result.summary["log_complete"] is False
    assert "No space left on device" in str(result.summary["log_shortfall"])


def test_the_panel_on_a_terminal_keeps_the_alarm_until_it_is_over() -> None:
    told = StringIO()
    progress = LiveProgress(Console(file=told, force_terminal=True, width=120), 0.04)
    progress.alarm("the disk is full")
    progress.tick(record())
    progress.close(OUTCOME)
    assert "the disk is full" in told.getvalue()


@pytest.mark.parametrize("replaced", [False, True])
def test_a_log_that_is_taken_away_is_told_at_once_and_at_the_end(replaced: bool, tmp_path: Path) -> None:
    path = tmp_path / "folder" / "log.mcap"
    alarms: list[str] = []
    recorder = McapRecorder(path, LogSettings(), Heading(), alarm=lambda _, __, text: alarms.append(text))
    recorder.tick(record(0))
    recorder.settle()
    path.unlink()
    path.parent.rmdir()
    if replaced:
        path.parent.mkdir()
        path.write_bytes(b"somebody else's")
    for number in range(1, 4):
        recorder.tick(record(number))
        recorder.settle()
    assert "the log cannot be written" in alarms[0]
    recorder.close(OUTCOME)
    assert ("another file stands in its place" if replaced else "the file is gone") in recorder.shortfall
    assert recorder.shortfall in alarms[-1]
    assert not recorder.complete


def test_a_log_that_is_taken_away_at_the_very_end_is_told(tmp_path: Path) -> None:
    recorder = McapRecorder(tmp_path / "log.mcap", LogSettings(), Heading())
    recorder.tick(record(0))
    (tmp_path / "log.mcap").unlink()
    recorder.close(OUTCOME)
    assert "the file is gone" in recorder.shortfall


def test_two_runs_cannot_take_one_name(tmp_path: Path) -> None:
    first = McapRecorder(tmp_path / "log.mcap", LogSettings(), Heading())
    first.tick(record(0))
    with pytest.raises(InputError, match=r"log\.mcap: the log cannot be written: File exists"):
        McapRecorder(tmp_path / "log.mcap", LogSettings(), Heading())
    first.close(OUTCOME)
    assert first.complete
    assert len(read_log(tmp_path / "log.mcap").ticks) == 1
