"""Records of MCAP files, parsed by the `mcap` package; what does not fit raises Damage and no other error.

The package takes a short read for a whole field and unpacks a chunk to any size; here both are Damage.
"""

from __future__ import annotations

import mmap
import os
import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

import lz4.frame
import zstandard
from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode

from bracket_ground.errors import LogError
from bracket_ground.files.files import regular

MAGIC = b"\x89MCAP0\r\n"
LARGEST_CHUNK_BYTES = 64 * 1024 * 1024
MOST_PACKED = 16  # or so often what is packed, where that is more
HEAD = struct.Struct("<BQ")  # opcode and length of a record
MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
CHECKSUM_BYTES = 4
FOOTER_BYTES = 9 + 20 + 8  # head, content, magic at the end of the file

_PARSERS: dict[int, Any] = {
    Opcode.HEADER: records.Header,
    Opcode.FOOTER: records.Footer,
    Opcode.SCHEMA: records.Schema,
    Opcode.CHANNEL: records.Channel,
    Opcode.CHUNK: records.Chunk,
    Opcode.MESSAGE_INDEX: records.MessageIndex,
    Opcode.ATTACHMENT: records.Attachment,
    Opcode.METADATA: records.Metadata,
    Opcode.STATISTICS: records.Statistics,
    Opcode.DATA_END: records.DataEnd,
}


class Damage(Exception):
    """Why a record cannot be taken; becomes a LogError with the place."""


class TooLarge(Damage):
    """Nothing is wrong with it, but it would take more memory than a file may ask for."""


class CutOff(Damage):
    """The data end before the record does."""


@contextmanager
def opened(path: Path) -> Iterator[mmap.mmap | bytes]:
    """The bytes of a file, which the system reads as they are looked at.

    Raises:
        LogError: it cannot be read.
    """
    try:
        with regular(path).open("rb") as stream:
            size = os.fstat(stream.fileno()).st_size
            whole: mmap.mmap | bytes = mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) if size else b""
    except (OSError, ValueError) as error:
        raise LogError(path, f"cannot be read: {getattr(error, 'strerror', None) or error}") from None
    yield whole  # the views of it that are left close it


class _ExactStream(ReadDataStream):
    """Reads all bytes that a field should have, or raises Damage."""

    def read(self, length: int) -> bytes:
        try:
            data = self._stream.read(length)
        except OverflowError:
            data = b""
        if len(data) != length:
            raise Damage("a field is longer than its record")
        self._count += length
        return data


def cut(data: memoryview, at: int) -> tuple[int, memoryview]:
    """Opcode and body of the record at a place.

    Raises:
        CutOff: it runs over the end.
    """
    if at < 0 or at + HEAD.size > len(data):
        raise CutOff("the file ends in mid-record")
    opcode, length = HEAD.unpack_from(data, at)
    begin = at + HEAD.size
    if begin + length > len(data):
        raise CutOff("a record runs over the end of the file")
    return opcode, data[begin : begin + length]


def inside(chunk: memoryview) -> Iterator[tuple[int, memoryview]]:
    """Opcodes and bodies of a chunk's records.

    Raises:
        Damage: one runs over the chunk's end, or is no whole message.
    """
    at = 0
    while at < len(chunk):
        try:
            opcode, body = cut(chunk, at)
        except CutOff:
            raise Damage("a chunk ends in mid-record") from None
        if opcode == Opcode.MESSAGE and len(body) < MESSAGE.size:
            raise Damage("a message is too short")
        yield opcode, body
        at += HEAD.size + len(body)


def parse(opcode: int, body: memoryview) -> Any:
    """The record, or None for an opcode that this program does not know: the specification wants it ignored.

    Bytes after the last known field are ignored, as the specification wants.

    Raises:
        Damage: a field is missing or wrong, or an attachment does not match its checksum.
    """
    if opcode not in _PARSERS:
        return None
    stream = _ExactStream(BytesIO(body))
    try:
        record = _PARSERS[opcode].read(stream)
    except UnicodeDecodeError:
        raise Damage("a text is not UTF-8") from None
    if opcode == Opcode.ATTACHMENT:
        end = stream.count - CHECKSUM_BYTES
        checksum = int.from_bytes(body[end : stream.count], "little")
        if checksum and zlib.crc32(body[:end]) != checksum:
            raise Damage(f"attachment {record.name} does not match its checksum")
    return record


def unpacked(chunk: Any) -> memoryview:
    """Records of a chunk, checked.

    Args:
        chunk: a `mcap.records.Chunk`.

    Raises:
        Damage: it does not match its size or checksum, or cannot be decompressed.
    """
    data = _inflated(chunk.compression, chunk.data, chunk.uncompressed_size)
    if len(data) != chunk.uncompressed_size or (chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc):
        raise Damage("a chunk does not match its checksum")
    return memoryview(data)


def _inflated(compression: str, packed: bytes, size: int) -> bytes:
    """Content of at most one byte more than the promised size, so that a bomb stays small."""
    if compression == "":
        return packed
    if size > (most := max(LARGEST_CHUNK_BYTES, MOST_PACKED * len(packed))):
        raise TooLarge(f"a chunk of {len(packed)} bytes promises {size}; legal: up to {most}")
    try:
        if compression == "zstd":
            with zstandard.ZstdDecompressor().stream_reader(packed) as stream:
                return bytes(stream.read(size + 1))
        if compression == "lz4":
            return bytes(lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=size + 1))
    except (zstandard.ZstdError, RuntimeError, EOFError):
        raise Damage("a chunk cannot be decompressed") from None
    raise Damage(f"unknown compression {compression!r}; legal: none, zstd, lz4")
