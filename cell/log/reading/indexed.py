"""Questions about a piece of a log, answered from its index: only the chunks that hold the answer are read.

A log of a killed process has no index; it is read whole.
"""

from __future__ import annotations

import struct
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import BinaryIO

from mcap.exceptions import McapError
from mcap.reader import SeekingReader

from cell.interfaces.errors import LogError
from cell.log.reading.mcap_file import Message, read_mcap
from cell.log.reading.reader import files_of

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
        for path in reversed(self.paths) if reverse else self.paths:
            yield from _of_file(path, span, topics, reverse)

    def newest(self, topic: str, time_s: float, back_s: float = 5.0) -> Message | None:
        """The last message of a topic up to a time; None where there is none in so many seconds before it."""
        return next(self.messages(max(0.0, time_s - back_s), time_s, (topic,), reverse=True), None)


def _of_file(path: Path, span: tuple[int, int], topics: Collection[str] | None, reverse: bool) -> Iterator[Message]:
    try:
        with path.open("rb") as stream:
            if _begins_after(stream, span):
                return
            reader = SeekingReader(stream, validate_crcs=True)
            found = reader.iter_messages(topics, starting_at=span[0], ending_before=span[1], reverse=reverse)
            for _, channel, message in found:
                yield Message(channel.topic, channel.message_encoding, message.log_time, message.data)
    except OSError as error:
        raise LogError(path, f"cannot be read: {error.strerror or error}") from None
    except _NoIndexError:
        yield from _unindexed(path, span, topics, reverse)
    except (McapError, ValueError) as error:
        raise LogError(path, f"is damaged where it is needed: {error}") from None


class _NoIndexError(Exception):
    """The file ends before its index."""


def _begins_after(stream: BinaryIO, span: tuple[int, int]) -> bool:
    """Whether nothing of the span is in the file, by its statistics.

    Raises:
        _NoIndexError: it has none.
    """
    try:
        summary = SeekingReader(stream).get_summary()
    except (McapError, struct.error, ValueError, OSError):
        raise _NoIndexError from None
    if summary is None or summary.statistics is None or not summary.chunk_indexes:
        raise _NoIndexError
    counted = summary.statistics
    return counted.message_start_time >= span[1] or counted.message_end_time < span[0]


def _unindexed(path: Path, span: tuple[int, int], topics: Collection[str] | None, reverse: bool) -> Iterator[Message]:
    found = [
        message
        for message in read_mcap(path).messages
        if span[0] <= message.time_ns < span[1] and (topics is None or message.topic in topics)
    ]
    yield from sorted(found, key=lambda message: message.time_ns, reverse=reverse)


def _nanoseconds(time_s: float) -> int:
    return max(0, round(time_s * 1e9))
