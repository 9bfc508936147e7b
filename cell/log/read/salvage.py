"""Salvage of truncated and damaged logs: a complete file of all that is right in one, and what was lost."""

from __future__ import annotations

import json
import mmap
import re
import zlib
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from mcap import records
from mcap.opcode import Opcode

from cell.errors import LogError
from cell.log.read.mcap_file import PROFILE
from cell.log.read.records import CHECKSUM_BYTES, FOOTER_BYTES, HEAD, MAGIC, MESSAGE, Damage, opened, parse, unpacked
from cell.log.read.ticks import Gap
from cell.recording.copying import CopyingWriter

# An opcode and a length below 4 GiB: what the beginning of a record looks like.
RECORD_BEGIN = re.compile(rb"[\x01-\x0f][\s\S]{4}\x00\x00\x00\x00")
# Searching damaged stretches may unpack and checksum this often the file's own size, and no more.
SEARCH_EFFORT = 8
LEAST_EFFORT_BYTES = 128 * 1024 * 1024
CHUNK_BYTES = 64 * 1024
MOST_REMARKS = 1000
MOST_TICKS = 10**7  # a number beyond it is damage, not a gap


@dataclass(frozen=True)
class Loss:
    """What of a log could not be brought back.

    Attributes:
        bytes_skipped: of the damaged file.
        ticks_missing: spans that are not there between 0 and the last tick.
        messages_missing: by topic, from the numbers that messages have in their channel.
        unclosed: the end is missing; what came after the last record is unknown.
        unchecked: the file's own checksum tells of a change in a place that no other checksum covers.
        remarks: one line for each damaged place.
        foreign: what it is, where it is an MCAP file of another program; empty for logs of this one.
    """

    bytes_skipped: int = 0
    ticks_missing: tuple[Gap, ...] = ()
    messages_missing: Mapping[str, int] = field(default_factory=dict)
    unclosed: bool = False
    unchecked: bool = False
    remarks: tuple[str, ...] = ()
    foreign: str = ""

    @property
    def lossy(self) -> bool:
        return any(value for name, value in vars(self).items() if name != "foreign")

    def lines(self) -> list[str]:
        """What was lost, for people."""
        told = list(self.remarks)
        if self.unclosed:
            told.append("the log was not closed: what came after its last record is unknown")
        if self.unchecked:
            told.append("the checksum of the whole does not match")
        told += [str(gap) for gap in self.ticks_missing]
        for topic, count in self.messages_missing.items():
            told.append(
                f"{count} messages of {topic!r} are missing" if count > 1 else f"a message of {topic!r} is missing"
            )
        return told

    def plain(self) -> dict[str, Any]:
        """As JSON: spans as pairs."""
        return {**vars(self), "ticks_missing": [[gap.first, gap.last] for gap in self.ticks_missing]}


class Sink(Protocol):
    """Takes what is found, in the order of the file."""

    def take(self, record: Any) -> None:
        """One record of the `mcap` package, but for messages whose channel is unknown."""
        ...


@dataclass
class Salvage:
    """What was found in a file, in memory."""

    loss: Loss = field(default_factory=Loss)
    channels: dict[int, records.Channel] = field(default_factory=dict)
    messages: list[records.Message] = field(default_factory=list)
    attachments: list[records.Attachment] = field(default_factory=list)
    metadata: list[records.Metadata] = field(default_factory=list)

    def take(self, record: Any) -> None:
        """One more record."""
        if isinstance(record, records.Channel):
            self.channels.setdefault(record.id, record)
        elif isinstance(record, records.Message):
            self.messages.append(record)
        elif isinstance(record, records.Attachment):
            self.attachments.append(record)
        elif isinstance(record, records.Metadata):
            self.metadata.append(record)


def salvage(path: Path) -> Salvage:
    """Find every whole record of a file, whatever stands between them.

    Raises:
        LogError: the file cannot be read or holds no record.
    """
    found = Salvage()
    with opened(path) as data:
        found.loss = _Salvager(path, data, found).run()
    return found


def recover(path: Path, out: Path) -> Loss:
    """Write what can be salvaged of a log as a complete file; only a chunk of it is in memory.

    Messages of own logs are numbered anew; the loss stands in the metadata `recovered`.

    Raises:
        LogError: the log cannot be read, holds nothing of an MCAP file, or the new file cannot be written.
    """
    try:
        with opened(path) as data, out.open("xb") as stream:
            writer = CopyingWriter(stream, CHUNK_BYTES)
            salvager = _Salvager(path, data, writer)
            writer.renumber = salvager.profile == PROFILE
            writer.start(salvager.profile, "cell log recover")
            loss = salvager.run()
            if loss.lossy:
                writer.note("recovered", {name: json.dumps(value) for name, value in loss.plain().items()})
            writer.finish()
    except FileExistsError:
        raise LogError(out, "exists already; choose another file with --out") from None
    except OSError as error:
        raise LogError(out, f"cannot be written: {error.strerror or error}") from None
    except LogError:
        out.unlink(missing_ok=True)
        raise
    return loss


class _Salvager:
    """One walk over a file that goes on behind damage.

    Attributes:
        profile: what the writer calls its kind of file.
    """

    def __init__(self, path: Path, data: mmap.mmap | bytes, sink: Sink) -> None:
        self._path, self._data, self._view, self._sink = path, data, memoryview(data), sink
        self._effort_bytes = max(LEAST_EFFORT_BYTES, SEARCH_EFFORT * len(data))
        self._remarks: list[str] = []
        self._skipped = self._homeless = 0
        self._closed = self._unchecked = False
        self._counted: dict[str, int] = {}  # by the writer
        self._kept = dict.fromkeys(("messages", "attachments", "metadata"), 0)
        self._channels: dict[int, records.Channel] = {}
        self._last: dict[int, int] = {}  # number of the newest message, by channel
        self._missing: Counter[str] = Counter()
        self._ticks: list[list[int]] = []  # spans of those that are there
        self._of_run = False
        self.profile = self._profile()

    def run(self) -> Loss:
        """Hand everything to the sink.

        Raises:
            LogError: there is nothing.
        """
        at = len(MAGIC) if self._data[: len(MAGIC)] == MAGIC else 0
        if not at:
            self._remark("the file does not begin as an MCAP file")
        self._channels_of_index()
        while at < len(self._data) and not self._closed:
            try:
                at = self._record(at)
            except Damage as damage:
                at = self._resume(at, damage)
        loss = self._loss()
        if not any(self._kept.values()) and (loss.lossy or not self._data[: len(MAGIC)] == MAGIC):
            raise LogError(self._path, "holds nothing that can be salvaged")
        return loss

    def _profile(self) -> str:
        try:
            opcode, body = self._cut(len(MAGIC))
            return str(parse(opcode, body).profile) if opcode == Opcode.HEADER else ""
        except Damage:
            return ""

    def _channels_of_index(self) -> None:
        """Schemas and channels from the end of the file, for chunks that lost theirs."""
        try:
            opcode, body = self._cut(len(self._data) - FOOTER_BYTES)
            at = parse(opcode, body).summary_start if opcode == Opcode.FOOTER else 0
            kinds: list[tuple[int, memoryview]] = []
            while 0 < at < len(self._data) - FOOTER_BYTES:
                opcode, body = self._cut(at)
                if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                    kinds.append((opcode, body))
                elif opcode == Opcode.STATISTICS:
                    break
                at += HEAD.size + len(body)
            if opcode == Opcode.STATISTICS:
                self._take(kinds)
        except Damage:
            return

    def _remark(self, text: str) -> None:
        if len(self._remarks) < MOST_REMARKS:
            self._remarks.append(text)

    def _resume(self, at: int, damage: Damage) -> int:
        """Place of the next record that can be taken, past damage."""
        begin = at + 1
        while (match := RECORD_BEGIN.search(self._data, begin)) is not None:
            if self._effort_bytes <= 0:
                self._remark(f"search given up at byte {begin}: too many things look like records")
                break
            if self._plausible(match.start()):
                self._skip(at, match.start(), damage)
                return match.start()
            begin = match.start() + 1
        self._skip(at, len(self._data), damage)
        return len(self._data)

    def _skip(self, begin: int, end: int, damage: Damage) -> None:
        self._skipped += end - begin
        self._remark(f"{end - begin} bytes skipped at byte {begin}: {damage}")

    def _plausible(self, at: int) -> bool:
        """Whether a record that can be told from noise begins here: by checksum, or by text that fits exactly."""
        try:
            opcode, body = self._cut(at)
            self._effort_bytes -= 64
            if opcode == Opcode.CHUNK:
                for _ in self._chunk(body):
                    pass
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
        if at < 0 or at + HEAD.size > len(self._data):
            raise Damage("the file ends in mid-record")
        opcode, length = HEAD.unpack_from(self._data, at)
        begin = at + HEAD.size
        if begin + length > len(self._data):
            raise Damage("a record runs over the end of the file")
        return opcode, self._view[begin : begin + length]

    def _record(self, at: int) -> int:
        opcode, body = self._cut(at)
        if opcode == Opcode.CHUNK:
            self._take(list(self._chunk(body)))
        elif opcode in (Opcode.ATTACHMENT, Opcode.METADATA):
            record = parse(opcode, body)
            kind = "attachments" if opcode == Opcode.ATTACHMENT else "metadata"
            self._kept[kind] += 1
            self._of_run |= kind == "metadata" and record.name == "run"
            self._sink.take(record)
        elif opcode == Opcode.DATA_END:
            self._end(at, body)
        elif opcode in (Opcode.MESSAGE, Opcode.SCHEMA, Opcode.CHANNEL):
            if opcode == Opcode.MESSAGE and len(body) < MESSAGE.size:
                raise Damage("a message is too short")
            self._take([(opcode, body)])
        elif opcode == 0 or (opcode == Opcode.HEADER and at != len(MAGIC)):
            raise Damage(f"a record of type {opcode:#04x} stands where none may")
        else:
            parse(opcode, body)  # the header, an index, or a record that this program does not know
        return at + HEAD.size + len(body)

    def _chunk(self, body: memoryview) -> Iterator[tuple[int, memoryview]]:
        chunk = parse(Opcode.CHUNK, body)
        data = unpacked(chunk)
        self._effort_bytes -= len(data) + len(chunk.data)
        return _inner(data)

    def _take(self, found: list[tuple[int, memoryview]]) -> None:
        for opcode, body in found:
            if opcode == Opcode.MESSAGE:
                self._message(body)
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                record = parse(opcode, body)
                if opcode == Opcode.CHANNEL:
                    self._channels.setdefault(record.id, record)  # what the index says was first
                self._sink.take(record)
            elif opcode == Opcode.CHUNK:
                self._remark("a chunk within a chunk is left out")

    def _message(self, body: memoryview) -> None:
        channel_id, sequence, time_ns, published_ns = MESSAGE.unpack_from(body)
        channel = self._channels.get(channel_id)
        if channel is None:
            self._homeless += 1
            return
        data = bytes(body[MESSAGE.size :])
        self._kept["messages"] += 1
        if self.profile == PROFILE:
            gap = sequence - self._last.get(channel_id, 0) - 1
            self._last[channel_id] = sequence
            if gap:
                self._missing[channel.topic] += abs(gap)
        if channel.topic == "/tick":
            self._ticked(data)
        self._sink.take(records.Message(channel_id, time_ns, data, published_ns, sequence))

    def _ticked(self, data: bytes) -> None:
        try:
            number = json.loads(data)["tick"]
        except (ValueError, KeyError, TypeError, RecursionError):
            return
        if not isinstance(number, int) or not 0 <= number < MOST_TICKS:
            return
        if self._ticks and self._ticks[-1][1] in (number, number - 1):
            self._ticks[-1][1] = number
        else:
            self._ticks.append([number, number])

    def _end(self, at: int, body: memoryview) -> None:
        """The data's checksum, and what the writer counted."""
        checksum = parse(Opcode.DATA_END, body).data_section_crc
        self._unchecked = bool(checksum) and zlib.crc32(self._view[:at]) != checksum
        begin = at + HEAD.size + len(body)
        try:
            while begin < len(self._data) - len(MAGIC):
                opcode, record = self._cut(begin)
                if opcode == Opcode.STATISTICS:
                    told = parse(opcode, record)
                    self._counted = {
                        "messages": told.message_count,
                        "attachments": told.attachment_count,
                        "metadata": told.metadata_count,
                    }
                begin += HEAD.size + len(record)
        except Damage as damage:
            self._remark(f"the index is damaged: {damage}")
        self._closed = True

    def _loss(self) -> Loss:
        if self._homeless:
            self._remark(f"{self._homeless} messages whose channel is lost")
        for what, count in self._counted.items():
            if self._kept[what] != count:
                self._remark(f"{self._kept[what]} of {count} {what} are there")
        own = self.profile == PROFILE or self._of_run or any(one.topic == "/tick" for one in self._channels.values())
        return Loss(
            bytes_skipped=self._skipped,
            ticks_missing=tuple(_gaps(self._ticks)),
            messages_missing=dict(self._missing),
            unclosed=not self._closed or self._data[-len(MAGIC) :] != MAGIC,
            unchecked=self._unchecked,
            remarks=tuple(self._remarks),
            foreign="" if own else f"an MCAP file with profile {self.profile!r}, but not a log of this program",
        )


def _gaps(spans: list[list[int]]) -> Iterator[Gap]:
    """What is missing from 0 to the last of spans, which may stand in any order."""
    expected = 0
    for first, last in sorted(spans):
        if first > expected:
            yield Gap(expected, first - 1)
        expected = max(expected, last + 1)


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
