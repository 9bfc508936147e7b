"""A log for Rerun: the decisions as lines of text that it shows, beside images and frames, which it knows.

Rerun reads MCAP and the schemas of Foxglove, but keeps JSON as bytes. So what the log has as JSON becomes messages of
`foxglove.Log`: one entity for each node of the tree, for each kind of note, for commands, display and supervisor.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path

from foxglove import messages
from mcap.reader import make_reader

from bracket_cell.log.read.reader import Log, LoggedTick
from bracket_cell.log.report.text import command_text, display_text, note_text
from bracket_cell.recording.copying import CopyingWriter

PROTOBUF = "protobuf"
FOLDER, CHUNK_BYTES = "/decisions", 1024 * 1024
WARN, INFO = messages.LogLevel.Warning, messages.LogLevel.Info
_NOT_IN_A_NAME = re.compile(r"[^\w:/.\-]+")

Line = tuple[str, messages.LogLevel, str]


def write_for_rerun(log: Log, path: Path) -> int:
    """Write an MCAP file; returns how many lines of decisions there are.

    Raises:
        OSError: it cannot be written.
    """
    start_ns = began_ns(log)
    with path.open("wb") as stream:
        writer = CopyingWriter(stream, CHUNK_BYTES)
        writer.start("", "cell")
        _copy(log, writer, start_ns)
        count = _decisions(log, writer, start_ns)
        writer.finish()
    return count


def lines(log: Log) -> Iterator[tuple[float, Line]]:
    """(clock time, (topic, level, text)) of everything that was decided."""
    allowed = ""
    for tick in log.ticks:
        for change in tick.changes:
            words = f"{change.old.name} -> {change.new.name}"
            level = WARN if change.new.name == "FAILURE" else INFO
            said = f"{words}: {change.feedback}" if change.feedback else words
            yield tick.time_s, (f"{FOLDER}/nodes/{_name(change.path)}", level, said)
        for topic, fields in tick.notes:
            yield tick.time_s, (f"{FOLDER}/{topic}", INFO, " ".join(note_text(topic, fields).split()))
        if tick.command:
            yield tick.time_s, (f"{FOLDER}/command", INFO, " ".join(command_text(tick.command).split()[1:]))
        if tick.display:
            yield tick.time_s, (f"{FOLDER}/display", INFO, " ".join(display_text(tick.display).split()[1:]))
        if (now := _allowed(tick)) != allowed:
            allowed = now
            yield tick.time_s, (f"{FOLDER}/supervisor", WARN if ":" in now else INFO, now)


def _allowed(tick: LoggedTick) -> str:
    if tick.judgement is None:
        return ""
    reasons = "; ".join(one["words"] for one in tick.judgement["reasons"])
    return f"{tick.judgement['action']}: {reasons}" if reasons else str(tick.judgement["action"])


def _decisions(log: Log, writer: CopyingWriter, start_ns: int) -> int:
    schema, count = messages.Log.get_schema(), 0
    for count, (time_s, (topic, level, text)) in enumerate(lines(log), 1):  # noqa: B007 - counted
        writer.channel(topic, PROTOBUF, schema.name, schema.encoding, schema.data)
        at_ns = start_ns + round(time_s * 1e9)
        stamp = messages.Timestamp(at_ns // 10**9, at_ns % 10**9)
        line = messages.Log(timestamp=stamp, level=level, message=text, name=topic.rpartition("/")[2])
        writer.message(topic, at_ns, line.encode())
    return count


def _copy(log: Log, writer: CopyingWriter, start_ns: int) -> None:
    """What Rerun can read as it is: messages in protobuf, with their schemas."""
    topics = set()
    for path in log.parts:
        with path.open("rb") as stream:
            summary = make_reader(stream).get_summary()
        for channel in () if summary is None else summary.channels.values():
            if channel.message_encoding == PROTOBUF:
                schema = summary.schemas[channel.schema_id]  # type: ignore[union-attr]
                writer.channel(channel.topic, PROTOBUF, schema.name, schema.encoding, schema.data)
                topics.add(channel.topic)
    for message in log.messages:
        if message.topic in topics:
            writer.message(message.topic, start_ns + message.time_ns, message.data)


def _name(path: str) -> str:
    """A node's path as Rerun takes it for an entity."""
    return _NOT_IN_A_NAME.sub("_", path)


def began_ns(log: Log) -> int:
    """When the run began; times of the log count from there. 0 where the log does not say."""
    try:
        return round(datetime.fromisoformat(log.metadata["started_utc"]).timestamp() * 1e9)
    except (KeyError, ValueError):
        return 0
