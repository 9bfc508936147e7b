"""Exports for LeRobot and ROS: what they hold, and that the official reader opens them (`make readers`)."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import can
import cv2
import numpy as np
import pyarrow.parquet as parquet
import pytest

from bracket_cell.commands.main import main
from bracket_cell.log.read.reader import Log
from bracket_cell.log.report.export import export
from bracket_cell.log.training.lerobot import FilmedVideo, write_lerobot
from bracket_ground.errors import InputError
from tests import ROOT

READERS = ROOT / ".venv-readers" / "bin" / "python"
needs_readers = pytest.mark.skipif(not READERS.exists(), reason="make readers")

VIDEO = "observation.images.overhead"


@pytest.fixture(scope="module")
def data_set(assembly_log: Log, tray_log: Log, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("lerobot") / "set"
    write_lerobot([assembly_log, tray_log], folder)
    return folder


def rows(folder: Path, episode: int) -> dict[str, list[Any]]:
    table: dict[str, list[Any]] = parquet.read_table(folder / f"data/chunk-000/file-{episode:03d}.parquet").to_pydict()
    return table


@pytest.mark.long
def test_an_episode_has_a_row_for_each_frame_time(data_set: Path, assembly_log: Log) -> None:
    info = json.loads((data_set / "meta/info.json").read_text())
    assert (info["codebase_version"], info["total_episodes"], info["fps"]) == ("v3.0", 2, 15)
    counts = [len(rows(data_set, episode)["index"]) for episode in (0, 1)]
    assert sum(counts) == info["total_frames"]
    assert counts[0] == pytest.approx(15 * assembly_log.ticks[-1].time_s, abs=3)
    assert rows(data_set, 1)["index"] == list(range(counts[0], sum(counts)))
    first = rows(data_set, 0)["observation.state"][0]
    assert np.allclose(first[:6], assembly_log.ticks[0].observation.arm.positions_rad)
    videos = {name for name in info["features"] if name.startswith("observation.images.")}
    assert VIDEO in videos
    assert set(rows(data_set, 0)) | videos == set(info["features"])
    about = parquet.read_table(data_set / "meta/episodes/chunk-000/file-000.parquet").to_pydict()
    assert about["length"] == counts
    assert about[f"videos/{VIDEO}/to_timestamp"][0] == pytest.approx(counts[0] / 15)


@pytest.mark.parametrize("size", [(360, 481), (361, 480), (361, 481), (360, 480)])
def test_a_camera_has_any_size(size: tuple[int, int], tmp_path: Path) -> None:
    video = FilmedVideo(tmp_path / "a.mp4", 15.0)
    for _ in range(3):
        video.add(np.full((*size, 3), 80, np.uint8))
    video.close()
    there, image = cv2.VideoCapture(str(tmp_path / "a.mp4")).read()
    assert there
    assert image.shape == (*size, 3)


def test_of_a_slow_camera_there_is_a_row_a_second(
    assembly_log: Log, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bracket_cell.log.training.lerobot.rate_hz_of", lambda *_, **__: 0.3)
    assert write_lerobot([assembly_log], tmp_path / "set") > 0
    assert json.loads((tmp_path / "set/meta/info.json").read_text())["fps"] == 1


def test_images_that_the_log_left_out_change_no_rate(assembly_log: Log, tray_log: Log, tmp_path: Path) -> None:
    """A recorder whose disk does not keep up leaves out images first; the camera's rate stays what it is."""
    messages = assembly_log.messages
    kept = [message for message in messages if message.topic != "/camera/overhead" or not 1e9 < message.time_ns < 3e9]
    assert len(kept) < len(messages) - 20
    gap = replace(assembly_log, messages=tuple(kept))
    write_lerobot([gap, tray_log], tmp_path / "set")
    assert json.loads((tmp_path / "set/meta/info.json").read_text())["fps"] == 15
    assert len(rows(tmp_path / "set", 0)["index"]) == pytest.approx(16, abs=2)  # then none shows an image of before
    assert sum(rows(tmp_path / "set", episode)["next.done"][-1] for episode in range(3)) == 2


def test_a_gap_parts_episodes_and_no_row_is_made_up(tray_log: Log, tmp_path: Path) -> None:
    """What was asked of a moving arm is not known after a gap: it may have been told in it."""
    ticks = tray_log.ticks
    began = next(place for place in range(30, len(ticks)) if ticks[place].observation.arm.moving)
    log = replace(tray_log, ticks=(*ticks[: began - 10], *ticks[began + 5 :]))
    write_lerobot([log], tmp_path / "set")
    write_lerobot([tray_log], tmp_path / "whole")
    whole = rows(tmp_path / "whole", 0)
    parts = [rows(tmp_path / "set", episode) for episode in (0, 1)]
    assert [part["next.done"][-1] for part in parts] == [False, True]
    assert parts[0]["timestamp"][-1] < ticks[began - 10].time_s
    assert len(parts[0]["index"]) + len(parts[1]["index"]) < len(whole["index"]) - 15 * 0.04 * 15 + 2
    later = np.array(parts[1]["action"])
    assert np.allclose(later, np.array(whole["action"])[-len(later) :], atol=0.02)


def test_actions_are_where_the_arm_is_about_to_be(data_set: Path) -> None:
    table = rows(data_set, 1)
    states, actions = np.array(table["observation.state"])[:, :6], np.array(table["action"])[:, :6]

    def off_rad(rows_later: int) -> float:
        at = np.arange(5, len(states) - 5)
        return float(np.mean(np.abs(actions[at] - states[at + rows_later]).max(axis=1)))

    best = min(range(-5, 6), key=off_rad)
    assert 0 <= best <= 2
    assert off_rad(best) < 0.5 * off_rad(-3)
    assert off_rad(best) < 0.5 * off_rad(5)


def test_a_folder_that_is_there_is_left_alone(data_set: Path, assembly_log: Log) -> None:
    with pytest.raises(InputError, match="exists already"):
        write_lerobot([assembly_log], data_set)


def test_the_command_takes_several_logs_for_a_data_set(
    assembly_log: Log, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "set"
    logs = [str(assembly_log.path)] * 2
    assert main(["log", "export", *logs, "--to", "lerobot", "--out", str(out)]) == 2
    assert "is named twice" in capsys.readouterr().err
    logs[1] = shutil.copy(logs[0], str(tmp_path / "other.mcap"))
    assert main(["log", "export", *logs, "--to", "lerobot", "--out", str(out), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["rows"] == json.loads((out / "meta/info.json").read_text())["total_frames"]


def test_without_pyarrow_nothing_is_begun(assembly_log: Log, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(InputError, match="needs the package pyarrow"):
        write_lerobot([assembly_log], tmp_path / "set")
    assert not (tmp_path / "set").exists()


@needs_readers
@pytest.mark.slow
def test_lerobot_opens_the_data_set(data_set: Path) -> None:
    told = opened("lerobot", data_set)
    assert (told["episodes"], told["shape"]) == (2, [3, 360, 480])
    assert told["rows"] == sum(len(rows(data_set, episode)["index"]) for episode in (0, 1))
    assert all(0.1 < one < 0.9 for one in told["bright"])
    assert np.allclose(told["state"][0], rows(data_set, 0)["observation.state"][0])


def opened(what: str, path: Path) -> Any:
    command = [str(READERS), str(Path(__file__).with_name("open_exports.py")), what, str(path)]
    answer = subprocess.run(command, capture_output=True, text=True, check=True, env={"HF_HUB_OFFLINE": "1"})
    return json.loads(answer.stdout.splitlines()[-1])


def test_a_rosbag_has_joints_transforms_images_and_lines(assembly_log: Log, tmp_path: Path) -> None:
    from rosbags.rosbag2 import Reader
    from rosbags.typesys import Stores, get_typestore

    target = tmp_path / "bag"
    count = export(assembly_log, "rosbag2", target)
    known = get_typestore(Stores.ROS2_HUMBLE)
    found: dict[str, list[Any]] = {}
    with Reader(target) as reader:
        assert reader.message_count == count
        for connection, _, data in reader.messages():
            found.setdefault(connection.topic, []).append(known.deserialize_cdr(data, connection.msgtype))
    joints = found["/joint_states"]
    assert len(joints) == len(assembly_log.ticks)
    assert tuple(joints[5].position) == assembly_log.ticks[5].observation.arm.positions_rad
    images = [message for message in assembly_log.messages if message.topic == "/camera/overhead"]
    assert len(found["/camera/overhead/compressed"]) == len(images)
    assert found["/camera/overhead/compressed"][0].data.tobytes()[:2] == b"\xff\xd8"
    assert {transform.child_frame_id for message in found["/tf_static"] for transform in message.transforms} >= {
        "camera_overhead"
    }
    assert found["/rosout"]
    [bench] = found["/scene/bench"]
    named = {marker.ns for marker in bench.markers}
    assert {"bench", "holes"} <= named
    cubes = [marker for marker in bench.markers if marker.ns == "bench"]
    assert all(marker.type == marker.CUBE and marker.header.frame_id == "world" for marker in cubes)
    assert [marker.id for marker in cubes] == list(range(len(cubes)))
    written = {marker.text for marker in bench.markers if marker.type == marker.TEXT_VIEW_FACING}
    assert len(written) > 3
    hulls = [marker for marker in found["/scene/robot"][0].markers if marker.type == marker.TRIANGLE_LIST]
    assert hulls
    assert all(len(marker.points) % 3 == 0 and marker.points for marker in hulls)
    assert found["/scene/assembly"][1].markers[0].action == bench.markers[0].DELETEALL
    with pytest.raises(InputError, match="exists already"):
        export(assembly_log, "rosbag2", target)


def test_candump_lines_are_read_back_by_python_can(assembly_log: Log, tmp_path: Path) -> None:
    target = tmp_path / "bus.log"
    count = export(assembly_log, "candump", target)
    with can.LogReader(target) as reader:
        frames = list(reader)
    told = [json.loads(message.data) for message in assembly_log.messages if message.topic == "/can"]
    assert count == len(frames) == len(told) > 0
    assert [(frame.arbitration_id, frame.data.hex()) for frame in frames] == [
        (one["id"], one["data_hex"]) for one in told
    ]


@pytest.mark.parametrize("style", ["parquet", "transitions", "notes"])
def test_tables_join_by_run_and_tell_of_it(assembly_log: Log, tmp_path: Path, style: str) -> None:
    export(assembly_log, style, tmp_path / "table")
    table = parquet.read_table(tmp_path / "table")
    assert set(table.column("run_id").to_pylist()) == {assembly_log.metadata["run_id"]}
    assert table.schema.metadata[b"seed"] == assembly_log.metadata["seed"].encode()


def test_a_run_whose_end_is_unknown_is_no_failure(assembly_log: Log, tmp_path: Path) -> None:
    cut = replace(assembly_log, unfinished="was not closed", result={}, outcome={})
    write_lerobot([cut], tmp_path / "set")
    last = {name: values[-1] for name, values in rows(tmp_path / "set", 0).items()}
    assert last["next.done"] is False
    info = json.loads((tmp_path / "set/meta/info.json").read_text())
    assert not {"next.success"} & (last.keys() | info["features"].keys())  # no trainer reads a column with a null
    assert info["features"][VIDEO]["info"]["video.codec"] == "h264"
    about = parquet.read_table(tmp_path / "set/meta/episodes/chunk-000/file-000.parquet").to_pydict()
    assert len(about["stats/action/mean"][0]) == 7
