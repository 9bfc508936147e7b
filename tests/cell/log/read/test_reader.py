"""A log comes back whole, or with a typed error, or with what is missing at its end."""

from __future__ import annotations

import dataclasses
import random
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.writer import Writer

from bracket_cell.log.read.frames import Frames
from bracket_cell.log.read.mcap_file import Message, read_mcap
from bracket_cell.log.read.reader import read_log
from bracket_cell.log.read.records import HEAD, MAGIC
from bracket_cell.log.read.salvage import recover
from bracket_cell.log.read.ticks import TickBuilder
from bracket_cell.recording.recorder import Heading, McapRecorder
from bracket_cell.settings import LogSettings
from bracket_cell.watching.observer import SentCommand
from bracket_ground.errors import LogError
from bracket_ground.interfaces.command import Command, Display, GripperCommand, JointTrajectory
from tests.cell.fakes import frame, idle_view
from tests.cell.recording.test_recorder import OUTCOME, record

TICKS = 20


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A log of 20 ticks with an image each."""
    path = tmp_path / "log.mcap"
    recorder = McapRecorder(
        path, LogSettings(), Heading({"seed": "5"}, {"tree/a.xml": ("application/xml", b"<root/>")})
    )
    trajectory = JointTrajectory(np.array([0.0, 0.1]), np.full((2, 6), 1 / 3))
    busy = Command(follow=trajectory, gripper=GripperCommand(0.0401), display=Display(message="moving"))
    for number in range(TICKS):
        recorder.frame(frame(number, number * 0.04))
        recorder.tick(record(number, busy if number == 3 else None, SentCommand(trajectory) if number == 3 else None))
    recorder.close(dataclasses.replace(OUTCOME, ticks=TICKS))
    return path


def test_ticks_come_back_bit_for_bit(path: Path) -> None:
    log = read_log(path)
    view = record(0).observation.bench  # its sequence number never changes, so the log holds it once
    expected = [dataclasses.replace(record(number).observation, bench=view) for number in range(TICKS)]
    assert [tick.observation for tick in log.ticks] == expected
    assert log.ticks[7].changes == record(7).changes
    assert log.ticks[7].notes == record(7).notes
    assert log.ticks[3].command is not None
    assert log.ticks[3].command["follow"]["positions_rad"] == [[1 / 3] * 6] * 2
    assert log.ticks[3].display is not None
    assert log.ticks[4].command is None
    assert (log.metadata, log.attachments["tree/a.xml"]) == ({"seed": "5"}, b"<root/>")
    assert (log.outcome["end"], log.unfinished) == ("finished", "")


def test_a_log_cut_anywhere_tells_so_and_keeps_its_whole_ticks(path: Path) -> None:
    whole = path.read_bytes()
    most, begins = 0, whole.index(b"seed") + len("seed????5")  # the end of what the log says about its run
    for length in range(begins, len(whole), 97):
        path.write_bytes(whole[:length])
        log = read_log(path)
        assert log.unfinished
        assert [tick.number for tick in log.ticks] == list(range(len(log.ticks)))
        assert len(log.ticks) >= most, "a longer file holds fewer ticks"
        most = len(log.ticks)
    assert most == TICKS


def test_no_flipped_bit_loses_a_message_silently(path: Path) -> None:
    whole = path.read_bytes()
    messages = read_mcap(path).messages
    chance = random.Random(7)
    for _ in range(400):
        mutant = bytearray(whole)
        mutant[chance.randrange(len(mutant))] ^= 1 << chance.randrange(8)
        path.write_bytes(mutant)
        try:
            content = read_mcap(path)
        except LogError:
            continue
        assert content.unfinished or content.messages == messages


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "is not an MCAP file"),
        (b"<root/>", "is not an MCAP file"),
        (b"\x89MCAP0\r\n", "holds no run"),
        (b"\x89MCAP0\r\n\x01" + (12).to_bytes(8, "little") + b"\4\0\0\0cell\0\0\0\0\5" + b"\x80" * 9, "holds no run"),
        (b"\x89MCAP0\r\n\x06" + (9).to_bytes(8, "little") + bytes(9), "the first record, and no other, is a header"),
    ],
)
def test_what_is_no_log_is_refused(tmp_path: Path, content: bytes, reason: str) -> None:
    path = tmp_path / "x"
    path.write_bytes(content)
    with pytest.raises(LogError, match=reason):
        read_log(path)


def cropped(path: Path, first_tick: int, end_tick: int) -> Path:
    """A log without the messages of some ticks, as tools of others crop it: numbers and outcome stay as they were."""
    out = path.with_name("cropped.mcap")
    with path.open("rb") as stream, out.open("wb") as made:
        reader = make_reader(stream)
        writer = Writer(made)
        writer.start(profile=reader.get_header().profile, library="crop")
        for attachment in reader.iter_attachments():
            writer.add_attachment(0, 0, attachment.name, attachment.media_type, attachment.data)
        for metadata in reader.iter_metadata():
            writer.add_metadata(metadata.name, metadata.metadata)
        channels: dict[int, int] = {}
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            if channel.id not in channels:
                number = writer.register_schema(schema.name, schema.encoding, schema.data) if schema else 0
                channels[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, number)
            if first_tick * 0.04 - 0.001 < message.log_time / 1e9 < end_tick * 0.04 - 0.001:
                writer.add_message(
                    channels[channel.id], message.log_time, message.data, message.publish_time, message.sequence
                )
        writer.finish()  # type: ignore[no-untyped-call]
    return out


def test_a_log_whose_end_was_cropped_says_so(path: Path) -> None:
    log = read_log(cropped(path, 0, 12))
    assert len(log.ticks) == 12
    assert f"the run had {TICKS} ticks" in log.unfinished


def test_a_log_whose_beginning_was_cropped_says_so(path: Path) -> None:
    log = read_log(cropped(path, 5, TICKS))
    assert log.ticks[0].number == 5
    assert "the beginning was cropped" in log.unfinished


def test_images_come_back_by_time(path: Path, tmp_path: Path) -> None:
    frames = Frames(read_log(path))
    assert [(frame.camera, frame.time_s) for frame in frames.newest(0.1)] == [("overhead", 0.08)]
    [saved] = frames.save(0.1, tmp_path / "images", "tick000002")
    image = cv2.imread(str(saved))
    assert image is not None
    assert image.shape == (6, 8, 3)
    assert frames.newest(-1.0) == []


def test_edits_and_hooks_are_inputs_of_the_tick_that_they_act_in(path: Path) -> None:
    recorder = McapRecorder(
        path, LogSettings(), Heading({}, {"tree/a.xml": ("application/xml", b"<first/>")}), overwrite=True
    )
    recorder.tick(record(0))
    recorder.edited({"tree/a.xml": "<second/>"}, 0.04)
    recorder.tick(record(1))
    recorder.hooked("I", {"uid": 2}, 0.04)
    recorder.tick(record(2))
    recorder.close(OUTCOME)
    log = read_log(path)
    assert log.attachments["tree/a.xml"] == b"<first/>"
    assert [[(kind, one["tick"]) for kind, one in tick.inputs] for tick in log.ticks] == [
        [],
        [("edit", 1)],
        [("hook", 2)],
    ]
    assert log.ticks[1].inputs[0][1]["files"] == {"tree/a.xml": "<second/>"}


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"none\.mcap: cannot be read: No such file"):
        read_log(tmp_path / "none.mcap")


def without(path: Path, *ticks: int) -> Path:
    """A log that lost the chunks of these ticks, as `cell log export --to recovered` brings it back."""
    data = path.read_bytes()
    chunks = [(at, length) for at, opcode, length in records(data) if opcode == Opcode.CHUNK]
    for tick in sorted(ticks, reverse=True):
        at, length = chunks[tick]
        data = data[:at] + data[at + HEAD.size + length :]
    damaged, mended = path.with_name("damaged.mcap"), path.with_name("mended.mcap")
    damaged.write_bytes(data)
    assert recover(damaged, mended).lossy
    return mended


def records(data: bytes) -> Iterator[tuple[int, int, int]]:
    """(place, opcode, length) of every record of a closed file."""
    at = len(MAGIC)
    while at < len(data) - len(MAGIC):
        opcode, length = HEAD.unpack_from(data, at)
        yield at, opcode, length
        at += HEAD.size + length


def test_a_recovered_log_is_read_and_its_gaps_are_said(path: Path) -> None:
    log = read_log(without(path, 5, 6, 7, 12))
    assert [tick.number for tick in log.ticks] == [0, 1, 2, 3, 4, 8, 9, 10, 11, *range(13, TICKS)]
    assert [(gap.first, gap.last) for gap in log.gaps] == [(5, 7), (12, 12)]
    assert log.unfinished.startswith("ticks 5 to 7 are missing; tick 12 is missing")


def test_ticks_whose_inputs_are_lost_hold_none_for_them(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    recorder = McapRecorder(path, LogSettings(), Heading())
    for number in range(6):
        view = idle_view(frame(number // 3, number * 0.04))  # a new answer with tick 3
        recorder.tick(
            dataclasses.replace(record(number), observation=dataclasses.replace(record(number).observation, bench=view))
        )
    recorder.close(OUTCOME)
    log = read_log(without(path, 3))
    assert [tick.observation.bench is None for tick in log.ticks] == [False, False, False, True, True]
    assert "2 ticks saw answers of detectors that are missing" in log.unfinished
    assert "1 tick saw answers of detectors that are missing" in read_log(without(path, 3, 4)).unfinished


@pytest.mark.parametrize("data", [b"7", b"null", b"[1]", b'"x"', b"{"])
def test_a_message_that_is_no_object_is_one_clear_error(data: bytes, tmp_path: Path) -> None:
    for topic in ("/observation", "/note/belief", "/timing", "/judgement", "/state"):
        with pytest.raises(LogError, match="does not hold what it should"):
            TickBuilder(tmp_path).take(Message(topic, "json", 0, data))


@pytest.mark.parametrize("count", ["²", "9" * 5000, "-3", "many", ""])
def test_a_count_of_ticks_that_is_none_is_not_known(path: Path, count: str) -> None:
    log = replace(read_log(path), outcome={"ticks": count})
    assert log.ticks_of_run == log.ticks[-1].number + 1
