"""Rotated logs: every part can be read alone, and all together are the log in one file."""

from __future__ import annotations

import dataclasses
import errno
import gc
import os
import shutil
import weakref
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from pydantic import ValidationError

from bracket_cell.log.read.indexed import IndexedLog, parts_within
from bracket_cell.log.read.mcap_file import read_mcap
from bracket_cell.log.read.reader import Log, LogStream, read_log
from bracket_cell.log.replay.replay import Replay
from bracket_cell.log.report.node_statistics import node_statistics
from bracket_cell.log.report.query import Query, info, query
from bracket_cell.recording import joint_samples
from bracket_cell.recording import rotation as log_file
from bracket_cell.recording.packing import pack
from bracket_cell.recording.parts import part_path, parts_of
from bracket_cell.recording.recorder import Heading, McapRecorder
from bracket_cell.recording.sink import LogSink
from bracket_cell.settings import LogSettings
from bracket_ground.errors import LogError
from bracket_ground.interfaces.command import Command, Display
from tests.cell.conftest import COMMISSION
from tests.cell.conftest import recorded as run_recorded
from tests.cell.fakes import frame
from tests.cell.recording.test_recorder import OUTCOME, record, samples

TICKS = 40
HEADING = Heading({"seed": "5"}, {"tree/a.xml": ("application/xml", b"<root/>")})


def recorded(path: Path, overwrite: bool = False, **settings: Any) -> McapRecorder:
    """A log of 40 ticks with an image each; frame 4 was answered before the first, and the display never changes."""
    recorder = McapRecorder(
        path, LogSettings(**settings), HEADING, blackboard=lambda: {"part": "o1", "odd": object()}, overwrite=overwrite
    )
    for number in range(TICKS):
        recorder.frame(frame(number, number * 0.04))
        shown = Command(display=Display(message="moving")) if number == 0 else None
        recorder.tick(dataclasses.replace(record(number, shown), joints=samples(number)))
        recorder.settle()
    recorder.close(OUTCOME)
    return recorder


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log in parts of .4 s, and the same in one file."""
    folder = tmp_path_factory.mktemp("parts")
    recorded(folder / "log.mcap", rotate_s=0.4)
    recorded(folder / "whole.mcap")
    return folder


@pytest.fixture
def path(folder: Path, tmp_path: Path) -> Path:
    """The name of the log in parts, in a folder of its own."""
    for part in parts_of(folder / "log.mcap"):
        shutil.copy(part, tmp_path)
    return tmp_path / "log.mcap"


@pytest.fixture
def whole(folder: Path, path: Path) -> Path:
    """The same log in one file, beside its parts."""
    return Path(shutil.copy(folder / "whole.mcap", path))


def told(log: Log) -> list[tuple[str, int, bytes]]:
    return [(message.topic, message.time_ns, message.data) for message in log.messages]


def test_all_parts_together_are_the_log_in_one_file(whole: Path) -> None:
    path = whole
    one, parts = read_log(path), read_log(part_path(path, 1))
    assert len(parts.parts) == 4
    assert parts.ticks == one.ticks
    assert told(parts) == told(one)
    assert (parts.attachments, parts.metadata, parts.outcome) == (one.attachments, one.metadata, one.outcome)
    assert (parts.unfinished, parts.gaps) == ("", ())
    path.unlink()
    assert told(read_log(path)) == told(one), "the name without a number stands for all parts"
    assert told(read_log(parts_of(path))) == told(one)


def test_a_stream_tells_the_same_part_by_part(path: Path) -> None:
    whole, stream = read_log(path), LogStream(path)
    sizes, ticks, messages = [], [], []
    for piece in stream:
        sizes.append(len(piece.ticks))
        ticks += piece.ticks
        messages += piece.messages
    assert sizes == [10, 10, 10, 10]
    assert (tuple(ticks), tuple(messages)) == (whole.ticks, whole.messages)
    assert (stream.outcome, stream.unfinished, stream.altered) == (whole.outcome, "", False)
    assert info(LogStream(path)) == info(whole)
    assert node_statistics(LogStream(path)) == node_statistics(whole)
    assert list(query(LogStream(path), Query(topic="tick"))) == list(query(whole, Query(topic="tick")))


def test_a_stream_holds_one_part_at_a_time(path: Path) -> None:
    pieces = iter(LogStream(path))
    first = weakref.ref(next(pieces).ticks[0].observation)
    next(pieces), next(pieces)
    gc.collect()
    assert first() is None


def test_a_part_can_be_read_alone(path: Path) -> None:
    part = read_log(part_path(path, 3))
    assert [tick.number for tick in part.ticks] == list(range(20, 30))
    assert part.ticks[0].observation.bench is not None, "the part does not hold what its first tick saw"
    assert part.attachments["tree/a.xml"] == b"<root/>"
    [snapshot] = [message for message in part.messages if message.topic == "/snapshot"]
    assert b'"Assemble/park":"RUNNING"' in snapshot.data
    assert b'"part":"o1"' in snapshot.data
    assert b'"message":"moving"' in snapshot.data
    assert "the run's end is not in it" in part.unfinished
    with pytest.raises(LogError, match=r"begins with tick 20; .* name the first part"):
        Replay(part)


def test_the_official_reader_reads_every_part(path: Path) -> None:
    counts = []
    for part in parts_of(path):
        with part.open("rb") as stream:
            reader = make_reader(stream)
            summary = reader.get_summary()
            assert summary is not None
            assert summary.statistics is not None
            counts.append(sum(channel.topic == "/tick" for _, channel, _ in reader.iter_messages()))
            assert len(list(reader.iter_attachments())) == 1
    assert counts == [10, 10, 10, 10]


def test_parts_end_at_their_size(tmp_path: Path) -> None:
    recorded(tmp_path / "log.mcap", rotate_mb=0.02)
    sizes = [part.stat().st_size for part in parts_of(tmp_path / "log.mcap")]
    assert len(sizes) > 3
    assert max(sizes) < 40_000
    assert len(read_log(tmp_path / "log.0001.mcap").ticks) == TICKS


def test_only_so_many_parts_are_kept(tmp_path: Path) -> None:
    recorder = recorded(tmp_path / "log.mcap", rotate_s=0.2, keep_parts=3)
    assert (recorder.path, recorder.parts) == (tmp_path / "log.0006.mcap", 8)
    assert [part.name for part in parts_of(tmp_path / "log.mcap")] == [f"log.{n:04d}.mcap" for n in (6, 7, 8)]
    kept = read_log(tmp_path / "log.mcap")
    assert (kept.ticks[0].number, len(kept.ticks)) == (25, 15)
    recorded(tmp_path / "less.mcap", rotate_s=0.2, keep_mb=0.05)
    parts = parts_of(tmp_path / "less.mcap")
    assert sum(part.stat().st_size for part in parts[:-1]) <= 50_000
    assert 2 <= len(parts) < 8


def test_closed_parts_are_compressed(path: Path) -> None:
    for part in parts_of(path):
        with part.open("rb") as stream:
            summary = make_reader(stream).get_summary()
        assert summary is not None
        assert {index.compression for index in summary.chunk_indexes} == {"zstd"}
    assert not list(path.parent.glob("*.packing"))


def test_a_packed_file_holds_the_same_in_less_room(whole: Path) -> None:
    before, size_bytes = read_mcap(whole), whole.stat().st_size
    pack(whole)
    after = read_mcap(whole)
    assert whole.stat().st_size < 0.7 * size_bytes
    assert after == before


def test_a_part_that_cannot_be_packed_stays_as_it_is(tmp_path: Path) -> None:
    recorded(tmp_path / "log.mcap", rotate_s=0.4, compress=False)
    part = part_path(tmp_path / "log.mcap", 2)
    whole = part.read_bytes()
    damaged = bytearray(whole)
    damaged[len(whole) // 2] ^= 1
    part.write_bytes(damaged)
    with pytest.raises(Exception, match=r"(?i)crc|invalid|magic|opcode"):
        pack(part)
    assert part.read_bytes() == damaged
    assert not list(tmp_path.glob("*.packing"))


def test_keeping_parts_of_a_log_in_one_file_is_a_mistake() -> None:
    with pytest.raises(ValidationError, match="need rotate_mb, rotate_s or rotate_brackets"):
        LogSettings(keep_parts=3)


def test_parts_of_an_earlier_log_do_not_mix_with_a_new_one(path: Path) -> None:
    path.write_bytes(b"of an earlier run in one file")
    recorded(path, overwrite=True, rotate_s=1.0)
    assert len(parts_of(path)) == 2
    assert len(read_log(path).ticks) == TICKS


def test_a_missing_part_is_a_gap_that_is_said(path: Path) -> None:
    part_path(path, 2).unlink()
    log = read_log(path)
    assert [tick.number for tick in log.ticks] == [*range(10), *range(20, 40)]
    assert log.unfinished == "ticks 10 to 19 are missing"


def test_parts_of_two_runs_or_in_another_order_are_refused(path: Path) -> None:
    first, second, *_ = parts_of(path)
    with pytest.raises(LogError, match="is part 1 and stands after part 2"):
        read_log([second, first])
    other = path.with_name("other.mcap")
    recorder = McapRecorder(other, LogSettings(), Heading({"seed": "6"}))
    recorder.close(OUTCOME)
    with pytest.raises(LogError, match="is not part of a rotated log"):
        read_log([first, other])


def test_where_no_next_part_can_be_opened_the_old_one_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[Path] = []

    class Full(LogSink):
        def __init__(self, path: Path) -> None:
            opened.append(path)
            if len(opened) > 1:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            super().__init__(path)

    monkeypatch.setattr(log_file, "LogSink", Full)
    alarms: list[str] = []
    recorder = McapRecorder(
        tmp_path / "log.mcap", LogSettings(rotate_s=0.4), HEADING, alarm=lambda *told: alarms.append(str(told[2]))
    )
    for number in range(TICKS):
        recorder.tick(record(number))
        recorder.settle()
    recorder.close(OUTCOME)
    assert "no next part: No space left on device" in alarms[0]
    assert len(read_log(tmp_path / "log.mcap").ticks) == TICKS
    assert len(opened) < 5, "it is tried again in every tick"


@pytest.mark.slow
def test_replay_over_parts_is_that_of_one_file(commission_log: Log, tmp_path: Path) -> None:
    end_s = 6.0
    parts = run_recorded(tmp_path, COMMISSION, end_s, settings="  rotate_s: 1.4\n")
    assert len(parts.parts) > 3
    here, there = ([tick.observation for tick in log.ticks if tick.time_s <= end_s] for log in (parts, commission_log))
    assert len(here) > 140
    assert here == there
    comparison = Replay(parts).run()
    assert (comparison.identical, comparison.ticks) == (True, len(parts.ticks)), comparison.first


def test_joints_at_the_rate_of_the_arm_come_back(whole: Path) -> None:
    found = [one for one in read_mcap(whole).messages if one.topic == joint_samples.TOPIC]
    assert len(found) == TICKS
    for number, message in enumerate(found):
        expected, back = samples(number), joint_samples.decode(message.data)
        assert (back.times_s == expected.times_s).all()
        assert (back.positions_rad == expected.positions_rad).all()
        assert (back.velocities_rad_s == expected.velocities_rad_s.astype("f4")).all()
        assert (back.efforts_nm == expected.efforts_nm.astype("f4")).all()


@pytest.mark.parametrize("number", [2, 4])
def test_a_part_that_was_cut_off_is_read_and_said(path: Path, number: int) -> None:
    part = part_path(path, number)
    part.write_bytes(part.read_bytes()[: part.stat().st_size // 2])
    log = read_log(path)
    assert len(log.ticks) < TICKS
    assert "was not closed" in log.unfinished
    missing = set(range(TICKS)) - {tick.number for tick in log.ticks}
    assert missing <= set(range(10 * (number - 1), 10 * number))
    assert bool(log.gaps) == (number == 2)


@pytest.mark.parametrize("span", [(0.0, 0.1), (0.39, 0.41), (0.5, 0.9), (1.5, 99.0), (0.0, 99.0), (50.0, 60.0)])
def test_a_question_about_a_span_reads_only_its_parts_and_misses_nothing(path: Path, span: tuple[float, float]) -> None:
    whole = [message for message in read_log(path).messages if span[0] <= message.time_ns / 1e9 <= span[1]]
    found = list(IndexedLog(path).messages(*span))
    assert {(message.topic, message.time_ns, message.data) for message in whole} <= {
        (message.topic, message.time_ns, message.data) for message in found
    }
    parts = parts_of(path)
    within = parts_within(parts, *span)
    assert within
    assert within == parts[parts.index(within[0]) : parts.index(within[-1]) + 1]
    if span[1] < 0.4:
        assert within == parts[:1]
    log = read_log(within)
    wanted = [tick for tick in read_log(path).ticks if span[0] <= tick.time_s <= span[1]]
    assert [tick for tick in log.ticks if span[0] <= tick.time_s <= span[1]] == wanted


def test_a_part_without_index_counts_as_one_that_may_hold_everything(path: Path) -> None:
    parts = parts_of(path)
    parts[-1].write_bytes(parts[-1].read_bytes()[:-40])
    assert parts_within(parts, 0.0, 0.1)[0] == parts[0]
    assert parts_within(parts, 1.3, 1.4)[-1] == parts[-1]
