"""A log in the formats of other tools: CSV and Parquet tables, Groot2's .btlog, and a video of the overhead camera."""

from __future__ import annotations

import csv
import json
import struct
from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import can
import cv2

from bracket_cell.log.read.frames import Frames
from bracket_cell.log.read.joints import joint_names
from bracket_cell.log.read.reader import Log, LoggedTick
from bracket_cell.log.replay.logged_tree import logged_tree
from bracket_cell.log.report.for_ros import began_ns, write_rosbag
from bracket_cell.packages import needed
from bracket_cell.recording.images import Video
from bracket_cell.trees.node_library import node_registry
from bracket_ground.errors import InputError, LogError, words_of
from bracket_ground.files.files import whole_or_none
from btxml.views.groot2 import StatusBoard, tree_xml

Row = dict[str, Any]
BTLOG_MAGIC = b"BTCPP4-FileLogger2"
BTLOG_END_S = 2.0**48 / 1e6  # times are 6 bytes of [us]
BTLOG_HEAD = struct.Struct("<Bi")  # version, length of the XML
STANDARD_ID = 0x7FF
YELLOW_BGR, WHITE_BGR, BAR_BGR = (0, 220, 255), (255, 255, 255), (40, 30, 24)
BAR_PX, LINE_PX = 44, 18


def transitions(log: Log) -> Iterator[Row]:
    """One row for every change of a node's status: run, tick, time, path, uid, name, old, new, feedback."""
    for tick in log.ticks:
        for order, change in enumerate(tick.changes):
            yield {
                **_head(log, tick.number, tick.time_s, order),
                "path": change.path,
                "uid": change.uid,
                "name": change.path.rpartition("/")[2],
                "old": change.old.name,
                "new": change.new.name,
                "feedback": change.feedback,
            }


def notes(log: Log) -> Iterator[Row]:
    """One row for every note; what each topic has most of stands in columns, everything as JSON in `fields`."""
    for tick in log.ticks:
        for order, (topic, fields) in enumerate(tick.notes):
            yield {
                **_head(log, tick.number, tick.time_s, order),
                "topic": topic,
                "subject": _text(fields, "subject", "node", "goal"),
                "decision": _text(fields, "decision", "status"),
                "reason": _text(fields, "reason", "text"),
                "fields": json.dumps(dict(fields)),
            }


def _head(log: Log, tick: int, time_s: float, order: int) -> Row:
    return {"run_id": log.metadata.get("run_id", ""), "tick": tick, "time_s": time_s, "order_in_tick": order}


def _text(fields: Any, *names: str) -> str:
    """The first of these fields that a note has."""
    return next((str(fields[name]) for name in names if fields.get(name) is not None), "")


def export(log: Log, style: str, path: Path) -> int:
    """Write a log in a style, as `cell log export --to` names them; returns how many rows, frames or messages.

    Raises:
        LogError: the log does not hold what the format needs.
        InputError: the file cannot be written, or a package is missing.
    """
    if not log.ticks:
        raise LogError(log.path, "holds no tick that could be exported")
    writers: Mapping[str, Callable[[Log, Path], int]] = {
        "csv": _csv,
        "parquet": lambda log, path: _parquet(log, list(table(log)), path),
        "transitions": lambda log, path: _parquet(log, list(transitions(log)), path),
        "notes": lambda log, path: _parquet(log, list(notes(log)), path),
        "candump": _candump,
        "rosbag2": lambda log, partial: write_rosbag(log, partial, path.name),
        "btlog": _btlog,
        "video": lambda log, partial: _video(log, partial, path),
    }
    if style == "rosbag2" and path.exists():
        raise InputError(f"{path}: exists already; name a new folder")
    try:
        with whole_or_none(path) as partial:
            return writers[style](log, partial)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {words_of(error)}") from None


def table(log: Log) -> Iterator[dict[str, Any]]:
    """One row a tick, all with the same columns; what holds until it changes is repeated, but over no gap."""
    goals = list(dict.fromkeys(name for tick in log.ticks for name in (_belief(tick) or {})))
    belief: Mapping[str, float]
    joints = joint_names(log)
    for place, tick in enumerate(log.ticks):
        if log.begins_at(place):
            belief, message = {}, ""
        seen = tick.observation
        belief = _belief(tick) or belief
        message = tick.display["message"] if tick.display else message
        hand = seen.bench.hand if seen.bench else None
        yield {
            "run_id": log.metadata.get("run_id", ""),
            "tick": tick.number,
            "time_s": tick.time_s,
            "status": tick.status,
            "wall_s": tick.wall_s,
            "overrun": tick.overrun,
            **{f"{joint}_rad": angle for joint, angle in zip(joints, seen.arm.positions_rad, strict=False)},
            "arm_moving": seen.arm.moving,
            "opening_m": seen.gripper.opening_m,
            "holding": seen.gripper.holding,
            "action": str(seen.bench.action) if seen.bench else "",
            "hand_x_m": hand.fingertips_m[0] if hand else None,
            "hand_y_m": hand.fingertips_m[1] if hand else None,
            "holds": (hand.held_part or "") if hand else "",
            **{f"belief {name}": belief.get(name) for name in goals},
            "message": message,
            "notes": json.dumps([[topic, dict(fields)] for topic, fields in tick.notes]) if tick.notes else "",
        }


def _belief(tick: LoggedTick) -> Mapping[str, float] | None:
    return next((fields["goals"] for topic, fields in tick.notes if topic == "belief" and "goals" in fields), None)


def _csv(log: Log, path: Path) -> int:
    rows = list(table(log))
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    return len(rows)


def _parquet(log: Log, rows: list[dict[str, Any]], path: Path) -> int:
    """A table with what the log says of its run as metadata."""
    arrow, parquet = (needed(name, "Parquet (--to csv does not)", "parquet") for name in ("pyarrow", "pyarrow.parquet"))
    facts = {**log.metadata, **{f"outcome.{name}": value for name, value in log.outcome.items()}}
    parquet.write_table(arrow.Table.from_pylist(rows).replace_schema_metadata(facts), str(path))
    return len(rows)


def _candump(log: Log, path: Path) -> int:
    """Frames of the gripper's bus as `candump -L` writes them; those of one tick bear its time."""
    began_s, count = began_ns(log) / 1e9, 0
    writer = can.CanutilsLogWriter(path, channel="can0")
    try:
        for message in log.messages:
            if message.topic == "/can":
                fields = json.loads(message.data)
                data, at_s = bytes.fromhex(fields["data_hex"]), began_s + message.time_ns / 1e9
                received, long = not fields["sent"], fields["id"] > STANDARD_ID
                writer(can.Message(at_s, fields["id"], is_extended_id=long, data=data, is_rx=received, check=True))
                count += 1
    finally:
        writer.stop()
    return count


def _btlog(log: Log, path: Path) -> int:
    """Transitions of all nodes; times count from the run's begin, as a log knows no date."""
    tree = logged_tree(log)
    xml = tree_xml(tree, node_registry()).encode()
    board = StatusBoard(len(tree.nodes))
    board.record(0.0)
    records = []
    for tick in log.ticks:
        if not (all(0 < change.uid <= len(tree.nodes) for change in tick.changes) and tick.time_s < BTLOG_END_S):
            raise LogError(log.path, f"tick {tick.number} is of a node or a time that no run has")
        board.update(tick.changes, tick.time_s)
        records.append(board.take_transitions())
    content = b"".join(records)
    path.write_bytes(BTLOG_MAGIC + BTLOG_HEAD.pack(1, len(xml)) + xml + struct.pack("<q", 0) + content)
    return len(content) // 9


def _video(log: Log, path: Path, name: Path) -> int:
    """Frames of the overhead camera with what was detected, believed and shown at that time.

    Args:
        name: what the file will be called, for messages.
    """
    times_s = (frames := Frames(log)).times_s("overhead")
    if len(times_s) < 2:
        raise LogError(
            log.path, f"holds {len(times_s)} overhead frames; a video needs 2 (configuration: camera_frames)"
        )
    starts = [tick.time_s for tick in log.ticks]
    rows = list(table(log))
    video = Video(path, frames.rate_hz("overhead"), name)
    for time_s in times_s:
        stored = frames.at("overhead", time_s)
        assert stored is not None
        now = max(0, bisect_right(starts, time_s) - 1)
        video.add(_overlaid(stored.image(), log.ticks[now], rows[now]))
    return video.close()


def _overlaid(image: Any, tick: LoggedTick, row: Mapping[str, Any]) -> Any:
    canvas = cv2.copyMakeBorder(image, 0, BAR_PX, 0, 0, cv2.BORDER_CONSTANT, value=BAR_BGR)
    bench = tick.observation.bench
    if bench is not None and bench.hand is not None:
        left, top, right, bottom = bench.hand.box_px
        cv2.rectangle(canvas, (left, top), (right, bottom), YELLOW_BGR, 2)
    goals = {name.removeprefix("belief "): value for name, value in row.items() if name.startswith("belief ")}
    believed = "  ".join(f"{name} {value:.0%}" for name, value in goals.items() if value is not None)
    lines = (f"{tick.time_s:6.2f} s  {row['action']}  {row['message']}", believed)
    for i, text in enumerate(lines):
        origin = (8, image.shape[0] + LINE_PX * (i + 1))
        cv2.putText(canvas, text, origin, cv2.FONT_HERSHEY_SIMPLEX, 0.42, WHITE_BGR, 1, cv2.LINE_AA)
    return canvas
