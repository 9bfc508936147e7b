"""Exports: what other tools read is what the log holds."""

from __future__ import annotations

import csv
import json
import re
import struct
import sys
import time
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import behaviortreepy
import cv2
import pytest
from pyarrow import parquet

from bracket_cell.commands.main import main
from bracket_cell.log.read.reader import Log
from bracket_cell.log.report.export import BTLOG_HEAD, BTLOG_MAGIC, export, table
from bracket_ground.errors import InputError, LogError
from btxml.engine.status import Status
from btxml.views.groot2 import CODES

STATUSES = {code: status for status, code in CODES.items()}


def test_a_row_after_a_gap_repeats_nothing_of_before(assembly_log: Log) -> None:
    """Another bracket may have begun in it: nobody knows what was believed and shown then."""
    whole = list(table(assembly_log))
    place = next(at for at in range(1, len(whole)) if whole[at]["message"] and not assembly_log.ticks[at].display)
    gap = replace(assembly_log, ticks=(*assembly_log.ticks[: place - 1], *assembly_log.ticks[place:]))
    assert (whole[place]["message"], list(table(gap))[place - 1]["message"]) == (whole[place - 1]["message"], "")
    assert list(table(gap))[: place - 1] == whole[: place - 1]


def test_csv_has_a_row_for_every_tick(assembly_log: Log, tmp_path: Path) -> None:
    path = tmp_path / "ticks.csv"
    assert export(assembly_log, "csv", path) == len(assembly_log.ticks)
    with path.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [float(row["time_s"]) for row in rows] == [tick.time_s for tick in assembly_log.ticks]
    angles = [float(row["elbow_rad"]) for row in rows]
    assert angles == [tick.observation.arm.positions_rad[2] for tick in assembly_log.ticks]
    assert sum(float(rows[-1][name]) for name in rows[-1] if name.startswith("belief ")) == pytest.approx(1.0)


def test_parquet_is_the_same_table(assembly_log: Log, tmp_path: Path) -> None:
    path = tmp_path / "ticks.parquet"
    assert export(assembly_log, "parquet", path) == len(assembly_log.ticks)
    assert parquet.read_table(path).to_pylist() == list(table(assembly_log))


def test_transitions_and_notes_are_tables_with_the_run_id(assembly_log: Log, tmp_path: Path) -> None:
    count = export(assembly_log, "transitions", tmp_path / "t.parquet")
    rows = parquet.read_table(tmp_path / "t.parquet").to_pylist()
    assert count == len(rows) == sum(len(tick.changes) for tick in assembly_log.ticks)
    assert {row["run_id"] for row in rows} == {assembly_log.metadata["run_id"]}
    first = assembly_log.ticks[0].changes[0]
    assert (rows[0]["path"], rows[0]["new"], rows[0]["uid"]) == (first.path, first.new.name, first.uid)
    export(assembly_log, "notes", tmp_path / "n.parquet")
    told = [(topic, json.dumps(dict(fields))) for tick in assembly_log.ticks for topic, fields in tick.notes]
    found = parquet.read_table(tmp_path / "n.parquet").to_pylist()
    assert [(row["topic"], row["fields"]) for row in found] == told
    verdicts = [row for row in found if row["topic"] == "verdict"]
    assert verdicts
    assert all(row["decision"] in ("act", "wait", "ask", "refused") and row["reason"] for row in verdicts)


def test_what_parquet_needs_is_named(assembly_log: Log, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(InputError, match=r"--to csv does not.* needs the package pyarrow.*\[parquet\]"):
        export(assembly_log, "parquet", tmp_path / "ticks.parquet")


def transitions(path: Path) -> tuple[dict[int, str], list[tuple[int, int, int]]]:
    """Names of nodes by uid, and (time in [us], uid, status) of a file for Groot2's log view."""
    content = path.read_bytes()
    assert content.startswith(BTLOG_MAGIC)
    begin = len(BTLOG_MAGIC) + BTLOG_HEAD.size
    version, length = BTLOG_HEAD.unpack_from(content, len(BTLOG_MAGIC))
    assert version == 1
    xml = ElementTree.fromstring(content[begin : begin + length])
    names = {int(node.get("_uid", "0")): node.get("name", node.tag) for node in xml.iter() if node.get("_uid")}
    records = content[begin + length + 8 :]
    assert len(records) % 9 == 0
    pieces = (records[at : at + 9] for at in range(0, len(records), 9))
    return names, [(int.from_bytes(piece[:6], "little"), *struct.unpack("<HB", piece[6:])) for piece in pieces]


def test_btlog_holds_the_tree_and_every_transition(assembly_log: Log, tmp_path: Path) -> None:
    path = tmp_path / "run.btlog"
    count = export(assembly_log, "btlog", path)
    names, found = transitions(path)
    logged = [
        (tick.time_s, status_change)
        for tick in assembly_log.ticks
        for status_change in tick.changes
        if status_change.old is not status_change.new
    ]
    assert count == len(found) == len(logged)
    for (time_us, uid, status), (time_s, change) in zip(found, logged, strict=True):
        assert (time_us, uid) == (round(time_s * 1e6), change.uid)
        assert names[uid] in change.path.rpartition("/")[2]
        assert STATUSES[status] is change.new


def test_btlog_is_laid_out_as_behaviortree_cpp_lays_it_out(tmp_path: Path) -> None:
    """The same parser reads a file of BehaviorTree.CPP's own FileLogger2."""
    for wait_s in (0.1, 1.0, 10.0):  # its writer is a thread, and a flush while it writes may write bytes twice
        path = tmp_path / f"cpp{wait_s}.btlog"
        tree = behaviortreepy.BehaviorTreeFactory().create_tree_from_text(
            '<root BTCPP_format="4"><BehaviorTree ID="Main"><Fallback name="f"><AlwaysFailure name="a"/>'
            '<AlwaysSuccess name="b"/></Fallback></BehaviorTree></root>'
        )
        logger = behaviortreepy.FileLogger(tree, str(path))
        tree.tick_while_running()
        time.sleep(wait_s)
        logger.flush()
        names, found = transitions(path)
        if found:
            break
    told = [(names[uid], STATUSES[status]) for _, uid, status in found]
    idle, running, success, failure = Status.INVALID, Status.RUNNING, Status.SUCCESS, Status.FAILURE
    ticked = [("f", running), ("a", failure), ("b", success)]
    assert told == [*ticked, ("a", idle), ("b", idle), ("f", success), ("f", idle)]


def test_video_has_every_overhead_frame(assembly_log: Log, tmp_path: Path) -> None:
    path = tmp_path / "run.mp4"
    count = export(assembly_log, "video", path)
    assert count == sum(message.topic == "/camera/overhead" for message in assembly_log.messages)
    video = cv2.VideoCapture(str(path))
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == count
    times_ns = [message.time_ns for message in assembly_log.messages if message.topic == "/camera/overhead"]
    assert (count - 1) / video.get(cv2.CAP_PROP_FPS) == pytest.approx((times_ns[-1] - times_ns[0]) / 1e9, rel=1e-3)
    assert video.read()[0]


def test_a_video_of_which_images_are_missing_goes_no_slower(assembly_log: Log, tmp_path: Path) -> None:
    kept = [one for one in assembly_log.messages if one.topic != "/camera/overhead" or not 1e9 < one.time_ns < 9e9]
    export(replace(assembly_log, messages=tuple(kept)), "video", tmp_path / "run.mp4")
    assert cv2.VideoCapture(str(tmp_path / "run.mp4")).get(cv2.CAP_PROP_FPS) == pytest.approx(15, rel=1e-2)


def test_what_a_log_lacks_is_a_typed_error(assembly_log: Log, tmp_path: Path) -> None:
    with pytest.raises(LogError, match="a video needs"):
        export(replace(assembly_log, messages=()), "video", tmp_path / "run.mp4")
    with pytest.raises(LogError, match="no tick"):
        export(replace(assembly_log, ticks=()), "csv", tmp_path / "ticks.csv")
    assert main(["log", "export", str(assembly_log.path), "--to", "csv", "-o", str(tmp_path / "no" / "x.csv")]) == 2
    (tmp_path / "mine.csv").write_text("mine")
    assert main(["log", "export", str(assembly_log.path), "--to", "csv", "-o", str(tmp_path / "mine.csv")]) == 2
    assert (tmp_path / "mine.csv").read_text() == "mine"
    assert main(["log", "export", str(assembly_log.path), "--to", "xls"]) == 2


@pytest.mark.usefixtures("small_files")
@pytest.mark.parametrize(
    "command",
    [["report"], *(["log", "export", "--to", to] for to in ("csv", "parquet", "lerobot"))],
)
def test_a_full_disk_leaves_no_piece_of_a_file(
    command: list[str], assembly_log: Log, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A second try was refused, as the piece was there already."""
    out = tmp_path / "out"
    assert main([*command, str(assembly_log.path), "--out", str(out)]) == 2
    assert re.search(f"{re.escape(str(out))}: .*cannot be written", capsys.readouterr().err)
    assert list(tmp_path.iterdir()) == []
    if "lerobot" in command:  # always a new folder
        return
    out.write_text("old")
    assert main([*command, str(assembly_log.path), "--out", str(out), "--overwrite"]) == 2
    assert out.read_text() == "old"


@pytest.mark.usefixtures("small_files")
def test_a_video_that_a_full_disk_cuts_short_leaves_the_old_one(assembly_log: Log, tmp_path: Path) -> None:
    out = tmp_path / "run.mp4"
    out.write_text("old")
    assert main(["log", "export", "--to", "video", str(assembly_log.path), "--out", str(out), "--overwrite"]) == 2
    assert out.read_text() == "old"
    assert list(tmp_path.iterdir()) == [out]
