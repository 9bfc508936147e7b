"""Salvage of truncated and damaged logs: a complete file of all that is right in one, and what was lost."""

from __future__ import annotations

import json
import re
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mcap.opcode import Opcode
from mcap.writer import CompressionType, Writer

from cell.errors import LogError
from cell.log.read.mcap_file import PROFILE
from cell.log.read.records import CHECKSUM_BYTES, HEAD, MAGIC, MESSAGE, Damage, parse, unpacked
from cell.log.read.recovered import Loss, RecoveredMessage, Salvage, foreign, missing_messages, missing_ticks

# An opcode and a length below 4 GiB: what the beginning of a record looks like.
RECORD_BEGIN = re.compile(rb"[\x01-\x0f][\s\S]{4}\x00\x00\x00\x00")
# Searching damaged stretches may unpack and checksum this often the file's own size, and no more.
SEARCH_EFFORT = 8
LEAST_EFFORT_BYTES = 128 * 1024 * 1024
CHUNK_BYTES = 64 * 1024


def salvage(path: Path) -> Salvage:
    """Find every whole record of a file, whatever stands between them.

    Raises:
        LogError: the file cannot be read or holds no record.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise LogError(path, f"cannot be read: {error.strerror or error}") from None
    found = _Salvager(path, data).run()
    if not (found.messages or found.attachments or found.metadata):
        raise LogError(path, "holds nothing that can be salvaged")
    return found


class _Salvager:
    def __init__(self, path: Path, data: bytes) -> None:
        self._data = data
        self._view = memoryview(data)
        self._effort_bytes = max(LEAST_EFFORT_BYTES, SEARCH_EFFORT * len(data))
        self._found = Salvage(path)
        self._remarks: list[str] = []
        self._skipped = 0
        self._closed = self._unchecked = False
        self._counted: dict[str, int] = {}  # by the writer

    def run(self) -> Salvage:
        at = len(MAGIC) if self._data.startswith(MAGIC) else 0
        if not at:
            self._remarks.append("the file does not begin as an MCAP file")
        while at < len(self._data) and not self._closed:
            try:
                at = self._record(at)
            except Damage as damage:
                at = self._resume(at, damage)
        self._found.loss = self._loss()
        known = [one for one in self._found.messages if one.channel in self._found.channels]
        self._found.messages = known
        return self._found

    def _resume(self, at: int, damage: Damage) -> int:
        """Place of the next record that can be taken, past damage."""
        begin = at + 1
        while (match := RECORD_BEGIN.search(self._data, begin)) is not None:
            if self._effort_bytes <= 0:
                self._remarks.append(f"search given up at byte {begin}: too many things look like records")
                break
            if self._plausible(match.start()):
                self._skip(at, match.start(), damage)
                return match.start()
            begin = match.start() + 1
        self._skip(at, len(self._data), damage)
        return len(self._data)

    def _skip(self, begin: int, end: int, damage: Damage) -> None:
        self._skipped += end - begin
        self._remarks.append(f"{end - begin} bytes skipped at byte {begin}: {damage}")

    def _plausible(self, at: int) -> bool:
        """Whether a record that can be told from noise begins here: by checksum, or by text that fits exactly."""
        try:
            opcode, body = self._cut(at)
            self._effort_bytes -= 64
            if opcode == Opcode.CHUNK:
                self._chunk(body)
            elif opcode == Opcode.ATTACHMENT:
                self._effort_bytes -= len(body)
                return bool(any(body[-CHECKSUM_BYTES:])) and parse(opcode, body) is not None
            elif opcode == Opcode.METADATA:
                return bool(parse(opcode, body).name)
            elif opcode == Opcode.DATA_END:
                return self._ends_here(at, body)
            else:
                return False
        except Damage:
            return False
        return True

    def _ends_here(self, at: int, body: memoryview) -> bool:
        follows = at + HEAD.size + len(body)
        return len(body) == 4 and self._data[follows : follows + 1] in (b"\x02", b"\x03", b"\x04", b"\x08", b"\x0b")

    def _cut(self, at: int) -> tuple[int, memoryview]:
        if at + HEAD.size > len(self._data):
            raise Damage("the file ends in mid-record")
        opcode, length = HEAD.unpack_from(self._data, at)
        begin = at + HEAD.size
        if begin + length > len(self._data):
            raise Damage("a record runs over the end of the file")
        return opcode, self._view[begin : begin + length]

    def _record(self, at: int) -> int:
        opcode, body = self._cut(at)
        if opcode == Opcode.CHUNK:
            self._take(self._chunk(body))
        elif opcode == Opcode.HEADER and at == len(MAGIC):
            self._found.profile = parse(opcode, body).profile
        elif opcode == Opcode.ATTACHMENT:
            self._found.attachments.append(parse(opcode, body))
        elif opcode == Opcode.METADATA:
            self._found.metadata.append(parse(opcode, body))
        elif opcode == Opcode.DATA_END:
            self._end(at, body)
        elif opcode in (Opcode.MESSAGE, Opcode.SCHEMA, Opcode.CHANNEL):
            if opcode == Opcode.MESSAGE and len(body) < MESSAGE.size:
                raise Damage("a message is too short")
            self._take([(opcode, body)])
        elif opcode in (Opcode.HEADER, 0):
            raise Damage(f"a record of type {opcode:#04x} stands where none may")
        else:
            parse(opcode, body)  # an index, or a record that this program does not know
        return at + HEAD.size + len(body)

    def _chunk(self, body: memoryview) -> list[tuple[int, memoryview]]:
        chunk = parse(Opcode.CHUNK, body)
        data = unpacked(chunk)
        self._effort_bytes -= len(data) + len(chunk.data)
        return list(_inner(data))

    def _take(self, records: list[tuple[int, memoryview]]) -> None:
        for opcode, body in records:
            if opcode == Opcode.MESSAGE:
                channel, sequence, time_ns, published_ns = MESSAGE.unpack_from(body)
                data = bytes(body[MESSAGE.size :])
                self._found.messages.append(RecoveredMessage(channel, sequence, time_ns, published_ns, data))
                continue
            record = parse(opcode, body)
            if opcode == Opcode.SCHEMA:
                self._found.schemas.setdefault(record.id, record)  # the index comes last
            elif opcode == Opcode.CHANNEL:
                self._found.channels.setdefault(record.id, record)

    def _end(self, at: int, body: memoryview) -> None:
        """The data's checksum, and channels from the index for chunks that lost theirs."""
        checksum = parse(Opcode.DATA_END, body).data_section_crc
        self._closed = self._data.endswith(MAGIC)
        self._unchecked = bool(checksum) and zlib.crc32(self._view[:at]) != checksum
        begin = at + HEAD.size + len(body)
        try:
            while begin < len(self._data) - len(MAGIC):
                opcode, record = self._cut(begin)
                if opcode == Opcode.STATISTICS:
                    counted = parse(opcode, record)
                    self._counted = {
                        "messages": counted.message_count,
                        "attachments": counted.attachment_count,
                        "metadata": counted.metadata_count,
                    }
                elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                    self._take([(opcode, record)])
                begin += HEAD.size + len(record)
        except Damage as damage:
            self._remarks.append(f"the index is damaged: {damage}")
        self._closed = True

    def _loss(self) -> Loss:
        found = self._found
        remarks = list(self._remarks)
        homeless = sum(one.channel not in found.channels for one in found.messages)
        if homeless:
            remarks.append(f"{homeless} messages whose channel is lost")
        kept = {
            "messages": len(found.messages) - homeless,
            "attachments": len(found.attachments),
            "metadata": len(found.metadata),
        }
        for what, count in self._counted.items():
            if kept[what] != count:
                remarks.append(f"{kept[what]} of {count} {what} are there")
        return Loss(
            bytes_skipped=self._skipped,
            ticks_missing=tuple(missing_ticks(found)),
            messages_missing=missing_messages(found),
            unclosed=not self._closed or not self._data.endswith(MAGIC),
            unchecked=self._unchecked,
            remarks=tuple(remarks),
            foreign=foreign(found),
        )


def _inner(data: memoryview) -> Iterator[tuple[int, memoryview]]:
    at = 0
    while at < len(data):
        if at + HEAD.size > len(data):
            raise Damage("a chunk ends in mid-record")
        opcode, length = HEAD.unpack_from(data, at)
        body = data[at + HEAD.size : at + HEAD.size + length]
        if len(body) != length or (opcode == Opcode.MESSAGE and length < MESSAGE.size):
            raise Damage("a chunk ends in mid-record")
        yield opcode, body
        at += HEAD.size + length


def recover(path: Path, out: Path) -> Loss:
    """Write what can be salvaged of a log as a complete file.

    Raises:
        LogError: the log cannot be read, holds nothing of an MCAP file, or the new file cannot be written.
    """
    found = salvage(path)
    try:
        with out.open("xb") as stream:
            _write(found, stream)
    except FileExistsError:
        raise LogError(out, "exists already; choose another file with --out") from None
    except OSError as error:
        raise LogError(out, f"cannot be written: {error.strerror or error}") from None
    return found.loss


def _write(found: Salvage, stream: Any) -> None:
    """A complete file; messages of own logs are numbered anew, the loss stands in the metadata `recovered`."""
    writer = Writer(stream, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD, enable_data_crcs=True)
    writer.start(profile=found.profile, library="cell log recover")
    for one in found.attachments:
        writer.add_attachment(one.create_time, one.log_time, one.name, one.media_type, one.data)
    for record in found.metadata:
        writer.add_metadata(record.name, record.metadata)
    if found.loss.lossy:
        writer.add_metadata("recovered", {name: json.dumps(value) for name, value in vars(found.loss).items()})
    schemas = {key: writer.register_schema(one.name, one.encoding, one.data) for key, one in found.schemas.items()}
    channels = {
        number: writer.register_channel(one.topic, one.message_encoding, schemas.get(one.schema_id, 0), one.metadata)
        for number, one in found.channels.items()
    }
    own = found.profile == PROFILE
    sequences: dict[int, int] = {}
    for message in found.messages:
        channel = channels[message.channel]
        sequences[channel] = sequences.get(channel, 0) + 1
        number = sequences[channel] if own else message.sequence
        writer.add_message(channel, message.time_ns, message.data, message.published_ns, number)
    writer.finish()  # type: ignore[no-untyped-call]
