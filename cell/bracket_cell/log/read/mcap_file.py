"""MCAP files: everything that a file holds, or a LogError; never less without saying so.

Whatever the specification of MCAP allows is read as it is.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mcap import records
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Footer, MetadataIndex, Statistics, SummaryOffset
from mcap.stream_reader import StreamReader

from bracket_cell.log.read.records import FOOTER_BYTES, Damage, TooLarge
from bracket_cell.log.read.walk import PROFILE, McapScanner, profile_in
from bracket_ground.errors import LogError

SALVAGE = "`cell log export --to recovered` brings back what is right in it"
HEAD_BYTES = 64 * 1024


def statistics(path: Path) -> Statistics | None:
    """How many messages a file has, and from when to when; None where it does not say."""
    return next((one for one in _group(path, Opcode.STATISTICS) if isinstance(one, Statistics)), None)


def metadata_names(path: Path) -> set[str]:
    """Names of the metadata in a file; empty where it does not say."""
    return {one.name for one in _group(path, Opcode.METADATA_INDEX) if isinstance(one, MetadataIndex)}


def _group(path: Path, opcode: int) -> Iterator[Any]:
    """Records of one kind, found by the offsets at the end of the file."""
    try:
        with path.open("rb") as stream:
            stream.seek(-FOOTER_BYTES, io.SEEK_END)
            footer = next(StreamReader(stream, skip_magic=True).records)
            if not isinstance(footer, Footer) or not footer.summary_offset_start:
                return
            stream.seek(footer.summary_offset_start)
            for offset in StreamReader(stream, skip_magic=True).records:
                if isinstance(offset, SummaryOffset) and offset.group_opcode == opcode:
                    stream.seek(offset.group_start)
                    group = io.BytesIO(stream.read(min(offset.group_length, path.stat().st_size)))
                    yield from StreamReader(group, skip_magic=True).records
                    return
    except (McapError, struct.error, ValueError, OSError, StopIteration):
        return


@dataclass(frozen=True, slots=True)
class Message:
    """One message; `data` is JSON text or protobuf, as `encoding` says."""

    topic: str
    encoding: str
    time_ns: int
    data: bytes


@dataclass
class McapContent:
    """What a file holds, messages in the order in which they were written.

    Attributes:
        profile: what the writer calls its kind of file; None where the file ends before it.
        attachments: content by name; of several with one name the first.
        metadata: values by name of the record; of several with one name the last.
        unfinished: where and how the file ends early; empty where it was closed as it should be.
        cropped: messages that some tool took away before the first one of a topic, by topic.
    """

    profile: str | None = None
    messages: list[Message] = field(default_factory=list)
    attachments: dict[str, bytes] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    unfinished: str = ""
    cropped: dict[str, int] = field(default_factory=dict)


def read_mcap(path: Path) -> McapContent:
    """Read a whole file; one that ends in mid-record is read up to there and marked `unfinished`.

    Raises:
        LogError: the file cannot be read, is no MCAP file, or is damaged.
    """
    data = _begin(path, -1)
    content = McapContent()
    walk = McapScanner(data, _Collector(content), strict=True)
    if not walk.begins:
        raise LogError(path, "is not an MCAP file: it does not begin like one")
    content.profile = walk.profile
    try:
        walk.run()
        rest = len(data) - walk.at
        if rest and walk.ends and not walk.closed:
            raise Damage("a record runs over the end of the file")
    except TooLarge as large:
        raise LogError(path, f"holds more at byte {walk.at} than this program reads: {large}") from None
    except Damage as damage:
        raise LogError(path, f"is damaged at byte {walk.at}: {damage}; {SALVAGE}") from None
    content.cropped = dict(walk.cropped)
    if not walk.closed:
        how = f"{rest} bytes of an unfinished record at" if rest else "it ends at"
        content.unfinished = f"was not closed: {how} byte {walk.at}"
    elif walk.unindexed:
        content.unfinished = "was not closed: its index is missing, its messages are whole"
    return content


def profile_of(path: Path) -> str | None:
    """What the writer calls its kind of file; None where it does not begin like one."""
    return profile_in(memoryview(_begin(path, HEAD_BYTES)))


def _begin(path: Path, size: int) -> bytes:
    """So many bytes of a file, or all of it; read and not mapped, as a file that is cut meanwhile ends the process."""
    try:
        with path.open("rb") as stream:
            return stream.read(size)
    except OSError as error:
        raise LogError(path, f"cannot be read: {error.strerror or error}") from None


class _Collector:
    """Keeps what a walk finds."""

    def __init__(self, content: McapContent) -> None:
        self._content = content
        self._channels: dict[int, tuple[str, str]] = {}

    def take(self, record: Any) -> None:
        """One more record.

        Raises:
            Damage: a log of this program has two attachments of one name.
        """
        content = self._content
        if isinstance(record, records.Message):
            content.messages.append(Message(*self._channels[record.channel_id], record.log_time, record.data))
        elif isinstance(record, records.Channel):
            self._channels[record.id] = record.topic, record.message_encoding
        elif isinstance(record, records.Attachment):
            first = content.attachments.setdefault(record.name, record.data)
            if first != record.data and content.profile == PROFILE:
                raise Damage(f"attachment {record.name} is there twice")
        elif isinstance(record, records.Metadata):
            content.metadata[record.name] = record.metadata
