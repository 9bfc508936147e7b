"""MCAP files: everything that a file holds, or a LogError; never less without saying so.

Every checksum and every count that the writer left is checked: file, chunks, attachments, statistics. In logs of this
program each message has its number in its channel, and these are checked, too. Whatever else the specification of MCAP
allows is read as it is.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Footer, MetadataIndex, Statistics, SummaryOffset
from mcap.stream_reader import StreamReader

from cell.errors import LogError
from cell.log.read.records import (
    FOOTER_BYTES,
    HEAD,
    MAGIC,
    MESSAGE,
    Damage,
    TooLarge,
    cut,
    parse,
    unpacked,
)

PROFILE = "cell"  # of the files that this program writes
SALVAGE = "`cell log recover` brings back what is right in it"
HEAD_BYTES = 64 * 1024
SUMMARY_CRC_BYTES = 16  # of the footer are covered by the checksum of the summary


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
    if data[: len(MAGIC)] != MAGIC:
        raise LogError(path, "is not an MCAP file: it does not begin like one")
    return _Reader(path, data).content()


def profile_of(path: Path) -> str | None:
    """What the writer calls its kind of file; None where it does not begin like one."""
    data = _begin(path, HEAD_BYTES)
    _, opcode, body = next(cut(memoryview(data), len(MAGIC)), (0, 0, memoryview(b"")))
    try:
        return str(parse(opcode, body).profile) if opcode == Opcode.HEADER and data[: len(MAGIC)] == MAGIC else None
    except Damage:
        return None


def _begin(path: Path, size: int) -> bytes:
    """So many bytes of a file, or all of it; read and not mapped, as a file that is cut meanwhile ends the process."""
    try:
        with path.open("rb") as stream:
            return stream.read(size)
    except OSError as error:
        raise LogError(path, f"cannot be read: {error.strerror or error}") from None


class _Reader:
    def __init__(self, path: Path, data: bytes) -> None:
        self._path = path
        self._data = memoryview(data)
        self._content = McapContent()
        self._schemas: set[int] = {0}  # schema 0 stands for none
        self._channels: dict[int, tuple[str, str]] = {}
        self._sequences: dict[int, int] = {}

    def content(self) -> McapContent:
        at = len(MAGIC)
        try:
            for begin, opcode, body in cut(self._data, at):
                at = begin
                if opcode == Opcode.DATA_END:
                    self._data_end(at, body)
                    return self._content
                self._record(opcode, body, first=at == len(MAGIC))
                at += HEAD.size + len(body)
        except TooLarge as large:
            raise LogError(self._path, f"holds more at byte {at} than this program reads: {large}") from None
        except Damage as damage:
            raise LogError(self._path, f"is damaged at byte {at}: {damage}; {SALVAGE}") from None
        rest = len(self._data) - at
        if bytes(self._data[-len(MAGIC) :]) == MAGIC and rest:
            raise LogError(self._path, f"is damaged at byte {at}: a record runs over the end of the file; {SALVAGE}")
        in_mid_record = f"{rest} bytes of an unfinished record at byte {at}" if rest else f"it ends at byte {at}"
        self._content.unfinished = f"was not closed: {in_mid_record}"
        return self._content

    def _record(self, opcode: int, body: memoryview, first: bool) -> None:
        if first != (opcode == Opcode.HEADER):
            raise Damage("the first record, and no other, is a header")
        if opcode == Opcode.MESSAGE:
            self._message(body)
            return
        record = parse(opcode, body)
        if opcode == Opcode.HEADER:
            self._content.profile = record.profile
        elif opcode == Opcode.SCHEMA:
            self._schemas.add(record.id)
        elif opcode == Opcode.CHANNEL:
            self._channel(record)
        elif opcode == Opcode.CHUNK:
            self._chunk(record)
        elif opcode == Opcode.ATTACHMENT:
            self._attachment(record)
        elif opcode == Opcode.METADATA:
            self._content.metadata[record.name] = record.metadata

    def _channel(self, record: Any) -> None:
        channel = record.topic, record.message_encoding
        if record.schema_id not in self._schemas:
            raise Damage(f"channel {record.topic} has no schema")
        if self._channels.setdefault(record.id, channel) != channel:
            raise Damage(f"channel {record.id} is both {self._channels[record.id][0]} and {record.topic}")

    def _message(self, body: memoryview) -> None:
        if len(body) < MESSAGE.size:
            raise Damage("a message is too short")
        channel, sequence, time_ns, _ = MESSAGE.unpack_from(body)
        if channel not in self._channels:
            raise Damage(f"a message of an unknown channel {channel}")
        topic, encoding = self._channels[channel]
        if self._content.profile == PROFILE:
            self._count(channel, topic, sequence)
        self._content.messages.append(Message(topic, encoding, time_ns, bytes(body[MESSAGE.size :])))

    def _count(self, channel: int, topic: str, sequence: int) -> None:
        """Messages of a channel are numbered from 1 without gaps; a tool may have cropped the first ones."""
        if channel not in self._sequences and sequence > 1:
            self._content.cropped[topic] = sequence - 1
        elif sequence != self._sequences.get(channel, 0) + 1:
            expected = self._sequences.get(channel, 0) + 1
            raise Damage(f"message {sequence} of {topic} stands where message {expected} should")
        self._sequences[channel] = sequence

    def _chunk(self, chunk: Any) -> None:
        data = unpacked(chunk)
        end = 0
        for at, opcode, body in cut(data, 0):
            if opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE):
                self._record(opcode, body, first=False)
            elif opcode == Opcode.CHUNK:
                raise Damage("a chunk stands within a chunk")
            end = at + HEAD.size + len(body)
        if end != len(data):
            raise Damage("a chunk ends in mid-record")

    def _attachment(self, record: Any) -> None:
        first = self._content.attachments.setdefault(record.name, record.data)
        if first != record.data and self._content.profile == PROFILE:
            raise Damage(f"attachment {record.name} is there twice")

    def _data_end(self, at: int, body: memoryview) -> None:
        checksum = parse(Opcode.DATA_END, body).data_section_crc
        if checksum and zlib.crc32(self._data[:at]) != checksum:
            raise Damage("what was written does not match the file's checksum")
        self._summary(at + HEAD.size + len(body))

    def _summary(self, begin: int) -> None:
        """Index and statistics after the messages; a file without them has lost nothing but was not closed."""
        if bytes(self._data[-len(MAGIC) :]) != MAGIC:
            self._content.unfinished = "was not closed: its index is missing, its messages are whole"
            return
        for at, opcode, body in cut(self._data[: -len(MAGIC)], begin):
            if opcode == Opcode.STATISTICS:
                self._check_count(parse(opcode, body).message_count)
            elif opcode == Opcode.FOOTER:
                checksum = parse(opcode, body).summary_crc
                if checksum and zlib.crc32(self._data[begin : at + HEAD.size + SUMMARY_CRC_BYTES]) != checksum:
                    raise Damage("the index does not match its checksum")
                if at + HEAD.size + len(body) + len(MAGIC) != len(self._data):
                    raise Damage("something stands between footer and end")
                return
        raise Damage("the footer is missing")

    def _check_count(self, count: int) -> None:
        if count != len(self._content.messages):
            raise Damage(f"{len(self._content.messages)} of {count} messages are there")
