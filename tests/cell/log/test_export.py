"""Exports: what other tools read is what the log holds."""

from __future__ import annotations

import csv
import struct
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree

import cv2
import pytest

from cell.commands import main
from cell.interfaces.errors import InputError, LogError
from cell.log.export import BTLOG_HEAD, BTLOG_MAGIC, export
from cell.log.reader import Log


def test_csv_has_a_row_for_every_tick(assembly_log: Log, tmp_path: Path) -> None:
    path = tmp_path / "ticks.csv"
    assert export(assembly_log, "csv", path) == len(assembly_log.ticks)
    with path.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [float(row["time_s"]) for row in rows] == [tick.time_s for tick in assembly_log.ticks]
    angles = [float(row["elbow_rad"]) for row in rows]
    assert angles == [tick.observation.arm.positions_rad[2] for tick in assembly_log.ticks]
    assert sum(float(rows[-1][name]) for name in rows[-1] if name.startswith("belief ")) == pytest.approx(1.0)


def test_parquet_is_the_same_table_or_names_what_is_missing(assembly_log: Log, tmp_path: Path) -> None:
    path = tmp_path / "ticks.parquet"
    if find_spec("pyarrow") is None:
        with pytest.raises(InputError, match="pyarrow"):
            export(assembly_log, "parquet", path)
        return
    assert export(assembly_log, "parquet", path) == len(assembly_log.ticks)
    assert path.read_bytes()[:4] == b"PAR1"


def test_btlog_holds_the_tree_and_every_transition(assembly_log: Log, tmp_path: Path) -> None:
    path = tmp_path / "run.btlog"
    count = export(assembly_log, "btlog", path)
    content = path.read_bytes()
    assert content.startswith(BTLOG_MAGIC)
    begin = len(BTLOG_MAGIC) + BTLOG_HEAD.size
    version, length = BTLOG_HEAD.unpack_from(content, len(BTLOG_MAGIC))
    assert version == 1
    uids = {int(node.get("_uid", "0")) for node in ElementTree.fromstring(content[begin : begin + length]).iter()}
    records = content[begin + length + 8 :]
    assert len(records) == 9 * count
    logged = [(tick.time_s, one) for tick in assembly_log.ticks for one in tick.changes if one.old is not one.new]
    assert count == len(logged)
    for i, (time_s, change) in enumerate(logged):
        record = records[9 * i : 9 * i + 9]
        assert int.from_bytes(record[:6], "little") == round(time_s * 1e6)
        assert struct.unpack("<H", record[6:8]) == (change.uid,)
        assert change.uid in uids


def test_video_has_every_overhead_frame(assembly_log: Log, tmp_path: Path) -> None:
    path = tmp_path / "run.mp4"
    count = export(assembly_log, "video", path)
    assert count == sum(message.topic == "/camera/overhead" for message in assembly_log.messages)
    video = cv2.VideoCapture(str(path))
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == count
    assert video.read()[0]


def test_what_a_log_lacks_is_a_typed_error(assembly_log: Log, tmp_path: Path) -> None:
    with pytest.raises(LogError, match="a video needs"):
        export(replace(assembly_log, messages=()), "video", tmp_path / "run.mp4")
    with pytest.raises(LogError, match="no tick"):
        export(replace(assembly_log, ticks=()), "csv", tmp_path / "ticks.csv")
    assert main(["log", "export", str(assembly_log.path), "--to", "csv", "-o", str(tmp_path / "no" / "x.csv")]) == 2
    assert main(["log", "export", str(assembly_log.path), "--to", "xls"]) == 2
