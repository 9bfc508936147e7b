"""MCAP files, record by record: everything that a file holds, or a LogError; never less without saying so.

Every checksum and every count that the writer left is checked: file, chunks, attachments, and the number that each
message has in its channel. The `mcap` package's reader checks few of them and leaks exceptions of its helpers.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import zstandard
from mcap.opcode import Opcode

from cell.interfaces.errors import LogError

MAGIC = b"\x89MCAP0\r\n"
LARGEST_CHUNK_BYTES = 64 * 1024 * 1024
HEAD = struct.Struct("<BQ")  # opcode and length of a record
MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time


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
        attachments: content by name.
        metadata: values by name of the record.
        unfinished: where and how the file ends early; empty where it was closed as it should be.
    """

    messages: list[Message] = field(default_factory=list)
    attachments: dict[str, bytes] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    unfinished: str = ""


def read_mcap(path: Path) -> McapContent:
    """Read a whole file; one that ends in mid-record is read up to there and marked `unfinished`.

    Raises:
        LogError: the file cannot be read, is no MCAP file, or is damaged.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise LogError(path, f"cannot be read: {error.strerror or error}") from None
    if data[: len(MAGIC)] != MAGIC:
        raise LogError(path, "is no MCAP file: it does not begin as one")
    return _Reader(path, data).content()


class Damage(Exception):
    """Why a record cannot be taken; becomes a LogError with the place."""


class Fields:
    """Takes the fields of a record one after the other; runs over its end never."""

    def __init__(self, data: memoryview) -> None:
        self._data = data
        self._at = 0

    def take(self, count: int) -> memoryview:
        piece = self._data[self._at : self._at + count]
        if len(piece) != count:
            raise Damage("a field is longer than its record")
        self._at += count
        return piece

    def number(self, code: str) -> int:
        layout = struct.Struct("<" + code)
        value: int = layout.unpack(self.take(layout.size))[0]
        return value

    def text(self) -> str:
        try:
            return str(self.take(self.number("I")), "utf-8")
        except UnicodeDecodeError:
            raise Damage("a text is not UTF-8") from None

    def mapping(self) -> dict[str, str]:
        inner = Fields(self.take(self.number("I")))
        found = {}
        while inner.left:
            name = inner.text()
            found[name] = inner.text()
        return found

    @property
    def left(self) -> int:
        return len(self._data) - self._at

    def end(self) -> None:
        if self.left:
            raise Damage(f"{self.left} bytes of a record belong to nothing")


class _Reader:
    def __init__(self, path: Path, data: bytes) -> None:
        self._path = path
        self._data = memoryview(data)
        self._content = McapContent()
        self._schemas: set[int] = {0}  # schema 0 stands for none
        self._channels: dict[int, tuple[str, str]] = {}
        self._sequences: dict[int, int] = {}
        self._take: Mapping[int, Callable[[Fields], None]] = {
            Opcode.SCHEMA: self._schema,
            Opcode.CHANNEL: self._channel,
            Opcode.CHUNK: self._chunk,
            Opcode.MESSAGE_INDEX: self._message_index,
            Opcode.ATTACHMENT: self._attachment,
            Opcode.METADATA: self._metadata,
        }

    def content(self) -> McapContent:
        at = len(MAGIC)
        try:
            for begin, opcode, body in self._records(self._data, at):
                at = begin
                if opcode == Opcode.DATA_END:
                    self._data_end(at, body)
                    return self._content
                self._record(opcode, body, first=at == len(MAGIC))
                at += HEAD.size + len(body)
        except Damage as damage:
            raise LogError(self._path, f"is damaged at byte {at}: {damage}") from None
        rest = len(self._data) - at
        if bytes(self._data[-len(MAGIC) :]) == MAGIC and rest:
            raise LogError(self._path, f"is damaged at byte {at}: a record runs over the end of the file")
        self._content.unfinished = f"was not closed: {rest} bytes of an unfinished record at byte {at}"
        return self._content

    def _records(self, data: memoryview, at: int) -> Iterator[tuple[int, int, memoryview]]:
        """(place, opcode, body) of whole records; ends before one that runs over the end."""
        while at + HEAD.size <= len(data):
            opcode, length = HEAD.unpack_from(data, at)
            begin = at + HEAD.size
            if begin + length > len(data):
                return
            yield at, opcode, data[begin : begin + length]
            at = begin + length

    def _record(self, opcode: int, body: memoryview, first: bool) -> None:
        if first != (opcode == Opcode.HEADER):
            raise Damage("the first record, and no other, is a header")
        fields = Fields(body)
        if opcode == Opcode.HEADER:
            fields.text()
            fields.text()
        elif opcode == Opcode.MESSAGE:
            self._message(body)
            return
        elif opcode in self._take:
            self._take[opcode](fields)
        else:
            raise Damage(f"a record of type {opcode:#04x} stands where none may")
        fields.end()

    def _schema(self, fields: Fields) -> None:
        self._schemas.add(fields.number("H"))
        fields.text()
        fields.text()
        fields.take(fields.number("I"))

    def _channel(self, fields: Fields) -> None:
        channel, schema = fields.number("H"), fields.number("H")
        topic, encoding = fields.text(), fields.text()
        fields.mapping()
        if schema not in self._schemas:
            raise Damage(f"channel {topic} has no schema")
        if self._channels.setdefault(channel, (topic, encoding)) != (topic, encoding):
            raise Damage(f"channel {channel} is both {self._channels[channel][0]} and {topic}")

    def _message(self, body: memoryview) -> None:
        if len(body) < MESSAGE.size:
            raise Damage("a message is too short")
        channel, sequence, time_ns, _ = MESSAGE.unpack_from(body)
        if channel not in self._channels:
            raise Damage(f"a message of an unknown channel {channel}")
        topic, encoding = self._channels[channel]
        expected = self._sequences.get(channel, 0) + 1
        if sequence != expected:
            raise Damage(f"message {sequence} of {topic} stands where message {expected} should")
        self._sequences[channel] = sequence
        self._content.messages.append(Message(topic, encoding, time_ns, bytes(body[MESSAGE.size :])))

    def _chunk(self, fields: Fields) -> None:
        fields.take(16)  # first and last time
        size, checksum = fields.number("Q"), fields.number("I")
        compression = fields.text()
        data = inflate(compression, bytes(fields.take(fields.number("Q"))), size)
        if len(data) != size or (checksum and zlib.crc32(data) != checksum):
            raise Damage("a chunk does not match its checksum")
        end = 0
        for at, opcode, body in self._records(memoryview(data), 0):
            if opcode not in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE):
                raise Damage(f"a chunk holds a record of type {opcode:#04x}")
            self._record(opcode, body, first=False)
            end = at + HEAD.size + len(body)
        if end != len(data):
            raise Damage("a chunk ends in mid-record")

    def _message_index(self, fields: Fields) -> None:
        if fields.number("H") not in self._channels:
            raise Damage("an index of an unknown channel")
        fields.take(fields.number("I"))

    def _attachment(self, fields: Fields) -> None:
        whole = fields.take(fields.left)
        inner = Fields(whole)
        inner.take(16)  # times of log and creation
        name, _ = inner.text(), inner.text()
        content = bytes(inner.take(inner.number("Q")))
        checksum = inner.number("I")
        inner.end()
        if checksum and zlib.crc32(whole[:-4]) != checksum:
            raise Damage(f"attachment {name} does not match its checksum")
        if self._content.attachments.setdefault(name, content) is not content:
            raise Damage(f"attachment {name} is there twice")

    def _metadata(self, fields: Fields) -> None:
        name = fields.text()
        self._content.metadata[name] = fields.mapping()

    def _data_end(self, at: int, body: memoryview) -> None:
        fields = Fields(body)
        checksum = fields.number("I")
        fields.end()
        if checksum and zlib.crc32(self._data[:at]) != checksum:
            raise Damage("what was written does not match the file's checksum")
        self._summary(at + HEAD.size + len(body))

    def _summary(self, begin: int) -> None:
        """Index and statistics after the messages; a file without them has lost nothing but was not closed."""
        if bytes(self._data[-len(MAGIC) :]) != MAGIC:
            self._content.unfinished = "was not closed: its index is missing, its messages are whole"
            return
        closed = False
        for at, opcode, body in self._records(self._data[: -len(MAGIC)], begin):
            closed = opcode == Opcode.FOOTER
            if opcode == Opcode.STATISTICS and (count := Fields(body).number("Q")) != len(self._content.messages):
                raise Damage(f"{len(self._content.messages)} of {count} messages are there")
            if closed:
                checksum = Fields(body[16:]).number("I")
                if checksum and zlib.crc32(self._data[begin : at + HEAD.size + 16]) != checksum:
                    raise Damage("the index does not match its checksum")
                if at + HEAD.size + len(body) + len(MAGIC) != len(self._data):
                    raise Damage("something stands between footer and end")
                break
        if not closed:
            raise Damage("the footer is missing")


def inflate(compression: str, packed: bytes, size: int) -> Any:
    """Uncompressed chunk of at most the size that it promises, so that a bomb stays small."""
    if size > LARGEST_CHUNK_BYTES:
        raise Damage(f"a chunk of {size} bytes; legal: up to {LARGEST_CHUNK_BYTES}")
    try:
        if compression == "":
            return packed
        if compression == "zstd":
            with zstandard.ZstdDecompressor().stream_reader(packed) as stream:
                return stream.read(size + 1)
    except zstandard.ZstdError as error:
        raise Damage(f"a chunk cannot be decompressed: {error}") from None
    raise Damage(f"unknown compression {compression!r}; legal: none, zstd")
