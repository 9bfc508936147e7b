"""The log, as the official MCAP reader reads it."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections import defaultdict
from dataclasses import MISSING, fields, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader

from bracket_cell.log.read.frames import Frames
from bracket_cell.log.read.reader import read_log
from bracket_cell.recording.recorder import Heading, McapRecorder
from bracket_cell.recording.schemas import plain
from bracket_cell.settings import LogSettings
from bracket_cell.skills.drivers.can_gripper import CanFrame
from bracket_cell.watching.observer import Outcome, SentCommand, TickRecord
from bracket_ground.errors import InputError
from bracket_ground.interfaces.command import Command, Display, GripperCommand, JointTrajectory
from bracket_ground.interfaces.notes import Topic
from bracket_ground.interfaces.observation import (
    ArmState,
    GripperState,
    JointSamples,
    ObjectStatus,
    Observation,
    Trouble,
)
from bracket_ground.interfaces.operator import OperatorState
from bracket_ground.interfaces.perception import PartsView
from bracket_ground.interfaces.pose import Pose
from btxml.engine.node import StatusChange
from btxml.engine.status import Status
from tests import ROOT
from tests.cell.fakes import frame, idle_view

OUTCOME = Outcome("finished", "the tree succeeded", 1, 0, 1.0, 0.5)


def record(tick: int = 0, command: Command | None = None, sent: SentCommand | None = None) -> TickRecord:
    """A tick at 25 Hz that saw frame 4 and ran one node."""
    time_s = tick * 0.04
    observation = Observation(
        tick=tick,
        time_s=time_s,
        arm=ArmState(time_s, (0.1, -1 / 3, 0.3, 0.4, 0.5, 0.6), (0.0,) * 6, False),
        gripper=GripperState(time_s, True, ObjectStatus.CONTACT_CLOSING, 0.028, 0.1, 0),
        bench=idle_view(frame(4, time_s)),
    )
    change = StatusChange("Assemble/park", 3, Status.INVALID, Status.RUNNING, "moving")
    notes: tuple[tuple[Topic, dict[str, object]], ...] = (("belief", {"goals": {"g0": 0.75, "g1": 0.25}}),)
    return TickRecord(
        observation,
        "RUNNING",
        (change,),
        notes,
        command or Command(),
        sent or SentCommand(),
        0.002,
        False,
    )


def samples(tick: int) -> JointSamples:
    """What an arm measured at 500 Hz in a tick of 40 ms."""
    times_s = (tick * 0.04 + np.arange(20) * 0.002).astype(np.float64)
    columns = np.sin(times_s[:, np.newaxis] * np.arange(1, 19)).astype(np.float64)
    return JointSamples(times_s, *np.split(columns, 3, axis=1))


def read(path: Path) -> dict[str, list[tuple[int, Any]]]:
    """(log time, content) of every message by topic; JSON decoded."""
    found = defaultdict(list)
    with path.open("rb") as stream:
        for _, channel, message in make_reader(stream).iter_messages():
            content = json.loads(message.data) if channel.message_encoding == "json" else message.data
            found[channel.topic].append((message.log_time, content))
    return found


def written(path: Path, *records: TickRecord) -> dict[str, list[tuple[int, Any]]]:
    """What a log of these ticks holds."""
    recorder = McapRecorder(path, LogSettings(), Heading())
    for tick_record in records:
        recorder.tick(tick_record)
    recorder.close(OUTCOME)
    return read(path)


def test_ticks_come_back_as_they_were(tmp_path: Path) -> None:
    found = written(tmp_path / "log.mcap", record(0), record(1))
    assert [time_ns for time_ns, _ in found["/tick"]] == [0, 40_000_000]
    _, tick = found["/tick"][1]
    assert tick["changes"] == [
        {"path": "Assemble/park", "uid": 3, "old": "INVALID", "new": "RUNNING", "feedback": "moving"}
    ]
    assert found["/note/belief"][0][1] == {"tick": 0, "goals": {"g0": 0.75, "g1": 0.25}}
    assert len(found["/bench"]) == 1, "an answer is written when it is new"


def test_every_field_of_an_observation_comes_back(tmp_path: Path) -> None:
    """What a node may read and no log holds is decided otherwise in a replay."""
    seen = replace(
        record().observation,
        parts=PartsView(4, 0.0, ()),
        troubles=(Trouble("arm", "it is gone"),),
        late_s=0.01,
        acknowledged=True,
        operator=OperatorState(present=True),
        signals={"door": False},
        speed_scale=0.0,
        work_s=0.5,
        holding_faults=("hand_too_near",),
    )
    usual = {field.name: field.default for field in fields(Observation) if field.default is not MISSING}
    assert not [name for name, value in usual.items() if getattr(seen, name) == value], "say another value here"
    written(tmp_path / "log.mcap", replace(record(), observation=seen))
    (tick,) = read_log(tmp_path / "log.mcap").ticks
    assert tick.observation == seen


def test_numbers_come_back_bit_for_bit(tmp_path: Path) -> None:
    one = record(7)
    _, seen = written(tmp_path / "log.mcap", one)["/observation"][0]
    assert tuple(seen["arm"]["positions_rad"]) == one.observation.arm.positions_rad
    assert seen["time_s"] == one.observation.time_s


def test_only_ticks_that_command_something_write_a_command(tmp_path: Path) -> None:
    trajectory = JointTrajectory(np.array([0.0, 0.5]), np.ones((2, 6)))
    busy = Command(follow=trajectory, gripper=GripperCommand(0.0401), display=Display(message="moving"))
    sent = SentCommand(trajectory, GripperCommand(0.04))
    found = written(tmp_path / "log.mcap", record(0), record(1, busy, sent), record(2))
    [(_, command)] = found["/command"]
    assert command["tick"] == 1
    assert command["follow"]["positions_rad"] == trajectory.positions_rad.tolist()
    assert (command["gripper"]["opening_m"], command["sent_gripper"]["opening_m"]) == (0.0401, 0.04)
    assert [display["message"] for _, display in found["/display"]] == ["moving"]


def test_camera_frames_are_jpeg_images(tmp_path: Path) -> None:
    recorder = McapRecorder(tmp_path / "log.mcap", LogSettings(jpeg_quality=95), Heading())
    recorder.frame(frame(0, 0.2))
    recorder.close(OUTCOME)
    [(time_ns, content)] = read(tmp_path / "log.mcap")["/camera/overhead"]
    assert time_ns == 200_000_000
    begin = content.index(b"\xff\xd8")
    image = cv2.imdecode(np.frombuffer(content[begin:], np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    assert np.abs(image.astype(int) - 128).max() < 4


def test_depths_are_kept_to_the_millimetre(tmp_path: Path) -> None:
    depth_mm = np.random.default_rng(0).integers(0, 2000, frame(0, 0.2).image.shape[:2]).astype(np.uint16)
    recorder = McapRecorder(tmp_path / "log.mcap", LogSettings(), Heading())
    recorder.frame(replace(frame(0, 0.2), depth_mm=depth_mm))
    recorder.close(OUTCOME)
    png = Frames(read_log(tmp_path / "log.mcap")).depth_at("overhead", 0.2)
    assert png is not None
    np.testing.assert_array_equal(cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_UNCHANGED), depth_mm)


def test_can_frames_are_in_the_log(tmp_path: Path) -> None:
    recorder = McapRecorder(tmp_path / "log.mcap", LogSettings(), Heading())
    recorder.can_frame(CanFrame(0.02, 0x18A, bytes(range(8)), sent=False))
    recorder.tick(record(0))
    recorder.close(OUTCOME)
    found = read(tmp_path / "log.mcap")
    assert found["/can"] == [(20_000_000, {"id": 0x18A, "sent": False, "data_hex": "0001020304050607"})]


def test_heading_and_outcome_are_attachments_and_metadata(tmp_path: Path) -> None:
    heading = Heading({"seed": "5"}, {"tree/assemble.xml": ("application/xml", b"<root/>")})
    recorder = McapRecorder(tmp_path / "log.mcap", LogSettings(), heading)
    recorder.message(0.0, "warning", "late")
    recorder.close(OUTCOME)
    with (tmp_path / "log.mcap").open("rb") as stream:
        reader = make_reader(stream)
        assert [(attachment.name, attachment.data) for attachment in reader.iter_attachments()] == [
            ("tree/assemble.xml", b"<root/>")
        ]
        metadata = {one.name: one.metadata for one in reader.iter_metadata()}
    assert metadata["run"] == {"seed": "5"}
    assert metadata["outcome"]["end"] == "finished"


def test_the_same_ticks_make_the_same_file(tmp_path: Path) -> None:
    for name in ("first", "second"):
        written(tmp_path / name, record(0), record(1))
    assert (tmp_path / "first").read_bytes() == (tmp_path / "second").read_bytes()


def test_a_log_of_a_killed_process_holds_all_its_ticks(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    script = (
        "import os, signal, pathlib; from bracket_cell.recording.recorder import *;"
        "from bracket_cell.settings import LogSettings;"
        "from tests.cell.recording.test_recorder import record; from tests.cell.fakes import frame;"
        f"r = McapRecorder(pathlib.Path({str(path)!r}), LogSettings(), Heading())\n"
        "for n in range(100): r.frame(frame(n, n * 0.04)); r.tick(record(n)); r.settle()\n"
        "os.kill(os.getpid(), signal.SIGKILL)"
    )
    result = subprocess.run([sys.executable, "-c", script], check=False, cwd=ROOT)
    assert result.returncode == -signal.SIGKILL
    topics: dict[int, str] = {}
    ticks = []
    with path.open("rb") as stream:
        try:
            for one in StreamReader(stream).records:
                if isinstance(one, Channel):
                    topics[one.id] = one.topic
                elif isinstance(one, Message) and topics[one.channel_id] == "/tick":
                    ticks.append(json.loads(one.data)["tick"])
        except McapError:
            pass  # the end is missing, as it must be
    assert ticks == list(range(100))


def test_a_path_that_cannot_be_written_is_an_input_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(InputError, match="the log cannot be written"):
        McapRecorder(tmp_path / "file" / "log.mcap", LogSettings(), Heading())


def test_a_run_that_did_not_begin_leaves_no_log(tmp_path: Path) -> None:
    recorder = McapRecorder(tmp_path / "log.mcap", LogSettings(), Heading())
    recorder.abandon()
    assert not (tmp_path / "log.mcap").exists()


def test_a_finished_log_is_not_abandoned(tmp_path: Path) -> None:
    recorder = McapRecorder(tmp_path / "log.mcap", LogSettings(), Heading())
    recorder.close(OUTCOME)
    recorder.abandon()
    assert (tmp_path / "log.mcap").exists()


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (float("nan"), "nan"),
        (float("-inf"), "-inf"),
        ({("o1", "p3"): np.float64(0.5)}, {"o1 p3": 0.5}),
        (np.arange(3), [0, 1, 2]),
        (Pose((1.0, 2.0, 3.0)), {"position_m": [1.0, 2.0, 3.0], "quaternion_wxyz": [1.0, 0.0, 0.0, 0.0]}),
        (ObjectStatus.MOVING, "MOVING"),
        (Path("a/b"), "a/b"),
    ],
)
def test_plain_data(value: object, expected: object) -> None:
    assert plain(value) == expected
    json.dumps(plain(value), allow_nan=False)


def test_what_is_no_data_is_refused() -> None:
    with pytest.raises(TypeError, match="a log cannot hold a function"):
        plain(plain)
