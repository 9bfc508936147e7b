"""One walk over an MCAP file: strict, or one that goes on behind damage and says what was lost."""

from __future__ import annotations

import mmap
import re
import zlib
from collections import Counter
from typing import Any, Protocol

import orjson
from mcap import records
from mcap.opcode import Opcode

from bracket_cell.log.read.records import (
    CHECKSUM_BYTES,
    FOOTER_BYTES,
    HEAD,
    MAGIC,
    MESSAGE,
    CutOff,
    Damage,
    cut,
    inside,
    parse,
    unpacked,
)
from bracket_ground.errors import counted

PROFILE = "cell"  # of the files that this program writes
# An opcode and a length below 4 GiB: what the beginning of a record looks like.
RECORD_BEGIN = re.compile(rb"[\x01-\x0f][\s\S]{4}\x00\x00\x00\x00")
# Searching damaged stretches may unpack and checksum this often the file's own size, and no more.
SEARCH_EFFORT = 8
LEAST_EFFORT_BYTES = 128 * 1024 * 1024
MOST_REMARKS = 1000
LONGEST_TICK_BYTES = 1_000_000  # what is longer is not looked into
MOST_TICKS = 10**7  # a number beyond it is damage, not a gap
SUMMARY_CRC_BYTES = 16  # of the footer are covered by the checksum of the summary
INSIDE = (Opcode.MESSAGE, Opcode.SCHEMA, Opcode.CHANNEL)
BESIDE = {Opcode.ATTACHMENT: "attachments", Opcode.METADATA: "metadata"}


class RecordSink(Protocol):
    """Takes what is found, in the order of the file."""

    def take(self, record: Any) -> None:
        """One record of the `mcap` package, but for messages whose channel is unknown.

        Raises:
            Damage: it contradicts another one.
        """
        ...


class McapScanner:
    """Hands every record of a file to a sink.

    Every checksum and every count that the writer left is checked: file, chunks, attachments, statistics. In logs of
    this program each message has its number in its channel, and these are checked, too.

    Attributes:
        at: where it is in the file; in the end behind the last record that is whole.
        profile: what the writer calls its kind of file; None where the file ends before it.
        closed: the end of the data was found.
        unindexed: ... but not that of the file.
        unchecked: the checksum of the whole does not match.
        remarks: one line for each damaged place.
        skipped: bytes that were passed over.
        cropped, missing: messages that are not there before the first one of a topic, and between others, by topic.
        ticks: spans of those that are there.
        kept: how many messages, attachments and metadata there are.
        of_run: it looks like a log of this program.

    Args:
        strict: the first damage is raised; else it is passed over.
    """

    def __init__(self, data: mmap.mmap | bytes, sink: RecordSink, *, strict: bool = False) -> None:
        self._data, self._view, self._sink, self._strict = data, memoryview(data), sink, strict
        self._effort_bytes = max(LEAST_EFFORT_BYTES, SEARCH_EFFORT * len(data))
        self._orphan_messages = 0
        self._counted: dict[str, int] = {}  # by the writer
        self._schemas = {0}  # schema 0 stands for none
        self._channels: dict[int, records.Channel] = {}
        self._last: dict[int, int] = {}  # number of the newest message, by channel
        self.remarks: list[str] = []
        self.skipped = 0
        self.closed = self.unindexed = self.unchecked = self.of_run = False
        self.kept = dict.fromkeys(("messages", "attachments", "metadata"), 0)
        self.cropped: Counter[str] = Counter()
        self.missing: Counter[str] = Counter()
        self.ticks: list[list[int]] = []
        self.at = len(MAGIC) if self.begins else 0
        self.profile = profile_in(self._view)

    @property
    def begins(self) -> bool:
        """Whether it begins as an MCAP file."""
        return self._data[: len(MAGIC)] == MAGIC

    @property
    def ends(self) -> bool:
        """Whether it ends as one."""
        return self._data[-len(MAGIC) :] == MAGIC

    def run(self) -> None:
        """Go on to the end of the data.

        Raises:
            Damage: at `at`, where it is strict.
        """
        if not self._strict:
            if not self.begins:
                self._remark("the file does not begin as an MCAP file")
            self._channels_of_index()
        while self.at < len(self._data) and not self.closed:
            try:
                self.at = self._record(self.at)
            except CutOff as damage:
                if self._strict:
                    break
                self.at = self._resume(self.at, damage)
            except Damage as damage:
                if self._strict:
                    raise
                self.at = self._resume(self.at, damage)
        if self._orphan_messages:
            self._remark(f"{counted(self._orphan_messages, 'message')} whose channel is lost")
        for what, count in self._counted.items():
            if self.kept[what] != count:
                self._remark(f"{self.kept[what]} of {count} {what} are there")
        self.of_run |= self.profile == PROFILE or any(channel.topic == "/tick" for channel in self._channels.values())

    def _remark(self, text: str) -> None:
        if len(self.remarks) < MOST_REMARKS:
            self.remarks.append(text)

    def _channels_of_index(self) -> None:
        """Schemas and channels from the end of the file, for chunks that lost theirs."""
        try:
            opcode, body = cut(self._view, len(self._data) - FOOTER_BYTES)
            footer = parse(opcode, body) if opcode == Opcode.FOOTER else None
            at, checksum = (0, 0) if footer is None else (footer.summary_start, footer.summary_crc)
            if at and checksum and zlib.crc32(self._view[at : -len(MAGIC) - CHECKSUM_BYTES]) != checksum:
                self._remark("the index is damaged, and left out")
                return
            kinds: list[tuple[int, memoryview]] = []
            while 0 < at < len(self._data) - FOOTER_BYTES:
                opcode, body = cut(self._view, at)
                if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                    kinds.append((opcode, body))
                elif opcode == Opcode.STATISTICS:
                    break
                at += HEAD.size + len(body)
            for kind in kinds if opcode == Opcode.STATISTICS else ():
                self._take(*kind)
        except Damage:
            return

    def _resume(self, at: int, damage: Damage) -> int:
        """Place of the next record that can be taken, past damage."""
        begin, found = at + 1, len(self._data)
        while (match := RECORD_BEGIN.search(self._data, begin)) is not None:
            if self._effort_bytes <= 0:
                self._remark(f"search given up at byte {begin}: too many things look like records")
                break
            if self._plausible(match.start()):
                found = match.start()
                break
            begin = match.start() + 1
        self.skipped += found - at
        self._remark(f"{found - at} bytes skipped at byte {at}: {damage}")
        return found

    def _plausible(self, at: int) -> bool:
        """Whether a record that can be told from noise begins here: by checksum, or by text that fits exactly."""
        try:
            opcode, body = cut(self._view, at)
            self._effort_bytes -= 64
            if opcode == Opcode.CHUNK:
                return bool(self._chunk(body)) or True
            if opcode == Opcode.ATTACHMENT:
                self._effort_bytes -= len(body)
                return bool(any(body[-CHECKSUM_BYTES:])) and parse(opcode, body) is not None
            if opcode == Opcode.METADATA:
                return bool(parse(opcode, body).name)
            follows = at + HEAD.size + len(body)
            next_one = self._data[follows : follows + 1]
            return (
                opcode == Opcode.DATA_END
                and len(body) == 4
                and next_one in (b"\x02", b"\x03", b"\x04", b"\x08", b"\x0b")
            )
        except Damage:
            return False

    def _record(self, at: int) -> int:
        opcode, body = cut(self._view, at)
        first = at == len(MAGIC)
        if (opcode == Opcode.HEADER and not first) or (self._strict and first and opcode != Opcode.HEADER):
            raise Damage("the first record, and no other, is a header")
        if opcode == Opcode.CHUNK:
            for inner in self._chunk(body):
                self._take(*inner)
        elif opcode in BESIDE:
            record = parse(opcode, body)
            self.kept[BESIDE[Opcode(opcode)]] += 1
            self.of_run |= opcode == Opcode.METADATA and record.name == "run"
            self._sink.take(record)
        elif opcode == Opcode.DATA_END:
            self._end(at, body)
        elif opcode in INSIDE:
            if opcode == Opcode.MESSAGE and len(body) < MESSAGE.size:
                raise Damage("a message is too short")
            self._take(opcode, body)
        elif opcode == 0 and not self._strict:
            raise Damage("a record of type 0x00 stands where none may")
        else:
            parse(opcode, body)  # the header, an index, or a record that this program does not know
        return at + HEAD.size + len(body)

    def _chunk(self, body: memoryview) -> list[tuple[int, memoryview]]:
        """All records of a chunk, once it is known to be whole."""
        chunk = parse(Opcode.CHUNK, body)
        data = unpacked(chunk)
        self._effort_bytes -= len(data) + len(chunk.data)
        return list(inside(data))

    def _take(self, opcode: int, body: memoryview) -> None:
        if opcode == Opcode.MESSAGE:
            self._message(body)
        elif opcode == Opcode.SCHEMA:
            schema = parse(opcode, body)
            self._schemas.add(schema.id)
            self._sink.take(schema)
        elif opcode == Opcode.CHANNEL:
            self._channel(parse(opcode, body))
        elif opcode == Opcode.CHUNK:
            if self._strict:
                raise Damage("a chunk stands within a chunk")
            self._remark("a chunk within a chunk is left out")

    def _channel(self, channel: records.Channel) -> None:
        known = self._channels.setdefault(channel.id, channel)  # what the index says was first
        if self._strict and channel.schema_id not in self._schemas:
            raise Damage(f"channel {channel.topic} has no schema")
        if self._strict and (known.topic, known.message_encoding) != (channel.topic, channel.message_encoding):
            raise Damage(f"channel {channel.id} is both {known.topic} and {channel.topic}")
        self._sink.take(channel)

    def _message(self, body: memoryview) -> None:
        number, sequence, time_ns, published_ns = MESSAGE.unpack_from(body)
        channel = self._channels.get(number)
        if channel is None:
            if self._strict:
                raise Damage(f"a message of an unknown channel {number}")
            self._orphan_messages += 1
            return
        if self.profile == PROFILE:
            self._count(channel, sequence)
        data = bytes(body[MESSAGE.size :])
        self.kept["messages"] += 1
        if channel.topic == "/tick" and not self._strict and len(data) < LONGEST_TICK_BYTES:
            self._ticked(data)
        self._sink.take(records.Message(number, time_ns, data, published_ns, sequence))

    def _count(self, channel: records.Channel, sequence: int) -> None:
        """Messages of a channel are numbered from 1 without gaps; a tool may have cropped the first ones.

        Of a channel that another tool added, all may be 0: not numbered (MCAP's specification).
        """
        first, expected = channel.id not in self._last, self._last.get(channel.id, 0) + 1
        if first and sequence == 0:
            return
        self._last[channel.id] = sequence
        if sequence == expected:
            return
        if first and sequence > 1 and self._strict:
            self.cropped[channel.topic] = sequence - 1
        elif self._strict:
            raise Damage(f"message {sequence} of {channel.topic} stands where message {expected} should")
        self.missing[channel.topic] += abs(sequence - expected)

    def _ticked(self, data: bytes) -> None:
        try:
            number = orjson.loads(data)["tick"]
        except (ValueError, KeyError, TypeError):
            return
        if not isinstance(number, int) or not 0 <= number < MOST_TICKS:
            return
        if self.ticks and self.ticks[-1][1] in (number, number - 1):
            self.ticks[-1][1] = number
        else:
            self.ticks.append([number, number])

    def _end(self, at: int, body: memoryview) -> None:
        """The data's checksum, and what the writer counted."""
        checksum = parse(Opcode.DATA_END, body).data_section_crc
        self.unchecked = bool(checksum) and zlib.crc32(self._view[:at]) != checksum
        if self._strict and self.unchecked:
            raise Damage("what was written does not match the file's checksum")
        self.unindexed = not self.ends
        try:
            if not (self._strict and self.unindexed):
                self._index(at + HEAD.size + len(body))
        except Damage as damage:
            if self._strict:
                raise Damage(str(damage)) from None  # a file that is closed is not cut off
            self._remark(f"the index is damaged: {damage}")
        self.closed = True

    def _index(self, begin: int) -> None:
        """What follows the data, up to the footer."""
        at = begin
        while at < len(self._data) - len(MAGIC):
            opcode, body = cut(self._view, at)
            follows = at + HEAD.size + len(body)
            if opcode == Opcode.STATISTICS:
                record = parse(opcode, body)
                counts = record.message_count, record.attachment_count, record.metadata_count
                self._counted = dict(zip(self.kept, counts, strict=True))
                if self._strict and record.message_count != self.kept["messages"]:
                    raise Damage(f"{self.kept['messages']} of {record.message_count} messages are there")
            elif opcode == Opcode.FOOTER and self._strict:
                checksum = parse(opcode, body).summary_crc
                if checksum and zlib.crc32(self._view[begin : at + HEAD.size + SUMMARY_CRC_BYTES]) != checksum:
                    raise Damage("the index does not match its checksum")
                if follows + len(MAGIC) != len(self._data):
                    raise Damage("something stands between footer and end")
                return
            at = follows
        if self._strict:
            raise Damage("the footer is missing")


def profile_in(data: memoryview) -> str | None:
    """What the writer calls its kind of file; None where it does not begin like one."""
    try:
        opcode, body = cut(data, len(MAGIC))
        return str(parse(opcode, body).profile) if opcode == Opcode.HEADER and data[: len(MAGIC)] == MAGIC else None
    except Damage:
        return None
