"""MCAP files: everything that a file holds, or a LogError; never less without saying so.

Whatever the specification of MCAP allows is read as it is.
"""

from __future__ import annotations

import io
import os
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

from mcap import records
from mcap.exceptions import McapError
from mcap.opcode import Opcode

from bracket_cell.log.read.records import FOOTER_BYTES, HEAD, MAGIC, Damage, TooLarge, parse
from bracket_cell.log.read.walk import PROFILE, McapScanner, profile_in
from bracket_ground.errors import LogError
from bracket_ground.files.files import regular

SALVAGE = "`cell log export --to recovered` brings back what is right in it"
HEAD_BYTES = 64 * 1024
FOOTER = struct.Struct("<BQQQI8s")  # opcode, length, starts of summary and of its offsets, checksum, magic
OFFSET = struct.Struct("<BQQ")  # opcode, start and length of a group of records
PLACE, LENGTH = struct.Struct("<QQ"), struct.Struct("<I")
NO_INDEX = (McapError, Damage, struct.error, ValueError, OSError)


def statistics(path: Path) -> records.Statistics | None:
    """How many messages a file has, and from when to when; None where it does not say."""
    try:
        with regular(path).open("rb") as stream:
            return next(
                (parse(Opcode.STATISTICS, memoryview(body)) for body in _group(stream, Opcode.STATISTICS)), None
            )
    except NO_INDEX:
        return None


def metadata_of(path: Path) -> dict[str, dict[str, str]]:
    """Metadata by name, found by the index of a file and nothing else of it; empty where it says of none.

    Read by hand: a folder has many thousand files, and nobody waits for each.
    """
    found = {}
    try:
        with regular(path).open("rb") as stream:
            for index in _group(stream, Opcode.METADATA_INDEX):
                at, size = PLACE.unpack_from(index)
                [body] = _bodies(_read(stream, at, size), Opcode.METADATA)
                [name], rest = _texts(body, 0, 1)
                (held,) = LENGTH.unpack_from(body, rest)
                texts, _ = _texts(body[: rest + LENGTH.size + held], rest + LENGTH.size)
                found[name] = dict(zip(texts[::2], texts[1::2], strict=True))
    except NO_INDEX:
        return {}
    return found


def _texts(body: bytes, at: int, count: int | None = None) -> tuple[list[str], int]:
    """So many texts from a place on, or all to the end, and where they end; in one loop, as there may be millions."""
    texts, end, unpack = list[str](), len(body), LENGTH.unpack_from
    while at < end and len(texts) != count:
        (size,) = unpack(body, at)
        at += LENGTH.size + size
        if at > end:
            raise ValueError("a text runs over the end of its record")
        texts.append(body[at - size : at].decode())
    return texts, at


def _group(stream: BinaryIO, opcode: int) -> Iterator[bytes]:
    """Bodies of the records of one kind, found by the offsets at the end of the file."""
    stream.seek(-FOOTER_BYTES, io.SEEK_END)
    kind, _, _, offsets_at, _, magic = FOOTER.unpack(stream.read())
    if (kind, magic) != (Opcode.FOOTER, MAGIC) or not offsets_at:
        return
    stream.seek(offsets_at)
    for offset in _bodies(stream.read()[: -len(MAGIC)], Opcode.SUMMARY_OFFSET):
        group, at, size = OFFSET.unpack(offset)
        if group == opcode:
            yield from _bodies(_read(stream, at, size), opcode)


def _read(stream: BinaryIO, at: int, size: int) -> bytes:
    stream.seek(at)
    return stream.read(min(size, os.fstat(stream.fileno()).st_size))


def _bodies(data: bytes, opcode: int) -> Iterator[bytes]:
    at = 0
    while at < len(data):
        kind, size = HEAD.unpack_from(data, at)
        at += HEAD.size + size
        if kind == opcode:
            yield data[at - size : at]


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
        with regular(path).open("rb") as stream:
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
