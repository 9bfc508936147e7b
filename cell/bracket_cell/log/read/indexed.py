"""Questions about a piece of a log, answered from its index: only the chunks that hold the answer are read.

A log of a killed process has no index; it is read whole.
"""

from __future__ import annotations

import math
import os
import struct
from bisect import bisect_left
from collections.abc import Collection, Iterator, Sequence
from heapq import heappop, heappush
from pathlib import Path
from typing import BinaryIO

from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.summary import Summary

from bracket_cell.log.read.mcap_file import SALVAGE, Message, read_mcap, statistics
from bracket_cell.log.read.reader import files_of
from bracket_cell.log.read.records import HEAD, MESSAGE, Damage, inside, parse, unpacked
from bracket_ground.errors import LogError
from bracket_ground.files.files import regular

FOREVER_S = 1e9


class IndexedLog:
    """The files of one run, in order, opened one at a time.

    Attributes:
        paths: a whole log, or the parts of a rotated one.
    """

    def __init__(self, paths: Path | Sequence[Path]) -> None:
        """Args:
        paths: a file, the first part of a rotated log or its name without a number for all parts, or several parts.
        """
        given = [paths] if isinstance(paths, Path) else list(paths)
        self.paths = files_of(given[0]) if len(given) == 1 else given
        self._summaries: dict[tuple[Path, int], Summary] = {}  # by path and size: an index takes longer than an answer

    def messages(
        self,
        from_s: float = 0.0,
        until_s: float = FOREVER_S,
        topics: Collection[str] | None = None,
        *,
        reverse: bool = False,
    ) -> Iterator[Message]:
        """Messages of a span of the run's clock, in the order of time; of some topics, or of all.

        Raises:
            LogError: a file cannot be read, or a chunk that is needed is damaged.
        """
        span = _nanoseconds(from_s), _nanoseconds(until_s) + 1
        paths = parts_within(self.paths, from_s, until_s)
        for path in reversed(paths) if reverse else paths:
            yield from self._of_file(path, span, topics, reverse)

    def newest(self, topic: str, time_s: float, back_s: float = 5.0) -> Message | None:
        """The last message of a topic up to a time; None if there is none within that many seconds before it."""
        return next(self.messages(max(0.0, time_s - back_s), time_s, (topic,), reverse=True), None)

    def _of_file(
        self, path: Path, span: tuple[int, int], topics: Collection[str] | None, reverse: bool
    ) -> Iterator[Message]:
        try:
            with regular(path).open("rb") as stream:
                yield from _in_order(stream, self._summary(path, stream), span, topics, reverse)
        except OSError as error:
            raise LogError(path, f"cannot be read: {error.strerror or error}") from None
        except _NoIndexError:
            yield from _unindexed(path, span, topics, reverse)
        except Damage as damage:
            raise LogError(path, f"is damaged where it is needed: {damage}; {SALVAGE}") from None

    def _summary(self, path: Path, stream: BinaryIO) -> Summary:
        """The index of an open file.

        Raises:
            _NoIndexError: the file ends before it, or it is damaged.
        """
        key = path, os.fstat(stream.fileno()).st_size
        if key not in self._summaries:
            try:
                summary = SeekingReader(stream, validate_crcs=True).get_summary()
            except (McapError, struct.error, ValueError, OSError, OverflowError):
                raise _NoIndexError from None
            if summary is None or not summary.chunk_indexes:
                raise _NoIndexError
            self._summaries[key] = summary
        return self._summaries[key]


def parts_within(paths: Sequence[Path], from_s: float, until_s: float) -> list[Path]:
    """Of the parts of a log those that hold a span of the run's clock; found by halving, from their indexes.

    A part whose index cannot be read counts as one that holds it.
    """
    if len(paths) == 1:
        return list(paths)
    begin_ns, end_ns = _nanoseconds(from_s), _nanoseconds(until_s)
    first = bisect_left(paths, True, key=lambda path: _ends_ns(path) >= begin_ns)
    after = bisect_left(paths, True, lo=first, key=lambda path: _begins_ns(path) > end_ns)
    return list(paths[min(first, len(paths) - 1) : max(after, first + 1)])


def _ends_ns(path: Path) -> float:
    counted = statistics(path)
    return math.inf if counted is None else float(counted.message_end_time)


def _begins_ns(path: Path) -> float:
    counted = statistics(path)
    return -math.inf if counted is None else float(counted.message_start_time)


class _NoIndexError(Exception):
    """The file ends before its index."""


def _in_order(
    stream: BinaryIO, summary: Summary, span: tuple[int, int], topics: Collection[str] | None, reverse: bool
) -> Iterator[Message]:
    """Messages by time; a chunk is read when its time has come. Raises: Damage: one that is needed is not whole."""
    sign = -1 if reverse else 1
    wanted = {number for number, channel in summary.channels.items() if topics is None or channel.topic in topics}
    begins = {
        chunk.chunk_start_offset: sign * (chunk.message_end_time if reverse else chunk.message_start_time)
        for chunk in summary.chunk_indexes
        if chunk.message_start_time < span[1] and chunk.message_end_time >= span[0]
        if wanted & chunk.message_index_offsets.keys() or not chunk.message_index_offsets
    }
    waiting: list[tuple[int, int, int, Message]] = []
    for at in sorted(begins, key=lambda at: (begins[at], sign * at)):
        while waiting and waiting[0][0] < begins[at]:
            yield heappop(waiting)[-1]
        for number, (channel_id, time_ns, data) in enumerate(_chunk(stream, at)):
            if span[0] <= time_ns < span[1] and channel_id in wanted:
                channel = summary.channels[channel_id]
                message = Message(channel.topic, channel.message_encoding, time_ns, bytes(data))
                heappush(waiting, (sign * time_ns, sign * at, sign * number, message))
    while waiting:
        yield heappop(waiting)[-1]


def _chunk(stream: BinaryIO, at: int) -> Iterator[tuple[int, int, memoryview]]:
    """Channel, time in [ns] and content of the messages of the chunk that begins at a place, which may be a lie."""
    rest = os.fstat(stream.fileno()).st_size - at - HEAD.size
    stream.seek(at if rest >= 0 else 0)
    opcode, length = HEAD.unpack(stream.read(HEAD.size))
    if opcode != Opcode.CHUNK or length > rest:
        raise Damage(f"no whole chunk begins at byte {at}")
    for kind, record in inside(unpacked(parse(opcode, memoryview(stream.read(length))))):
        if kind == Opcode.MESSAGE:
            channel, _, time_ns, _ = MESSAGE.unpack_from(record)
            yield channel, time_ns, record[MESSAGE.size :]


def _unindexed(path: Path, span: tuple[int, int], topics: Collection[str] | None, reverse: bool) -> Iterator[Message]:
    found = [
        message
        for message in read_mcap(path).messages
        if span[0] <= message.time_ns < span[1] and (topics is None or message.topic in topics)
    ]
    yield from sorted(found, key=lambda message: message.time_ns, reverse=reverse)


def _nanoseconds(time_s: float) -> int:
    return max(0, round(time_s * 1e9))
