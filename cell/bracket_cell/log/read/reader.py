"""A log as the run that it records: ticks with what each one saw and decided, attachments and metadata."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import orjson

from bracket_cell.log.read.mcap_file import McapContent, Message, metadata_of, profile_of, read_mcap, statistics
from bracket_cell.log.read.ticks import SNAPSHOT, Gap, TickBuilder, holding
from bracket_cell.log.read.ticks import LoggedTick as LoggedTick  # who reads a log needs them
from bracket_cell.log.read.ticks import Note as Note
from bracket_cell.log.read.walk import PROFILE
from bracket_cell.recording import identity as digest
from bracket_cell.recording.parts import part_number, parts_of, whole_path
from bracket_ground.errors import LogError, counted

T = TypeVar("T")
MOST_DIGITS = 18  # of a count
LOSSY = {"recovered", "dropped"}  # metadata of files that say themselves that something is missing


@dataclass(frozen=True)
class Log:
    """A run from its log.

    Attributes:
        path: the file; of several parts the first.
        attachments: content by name: configuration.yaml, product.yaml, tree/*.xml.
        metadata: seed, versions, hashes of weights and the like.
        outcome: how the run ended; empty where the log was cut off.
        ticks: in order; from 0 but where the first parts are not there.
        messages: everything in the order of writing, cameras and CAN frames included; what parts repeat at their
            beginning only once.
        unfinished: what is missing, in words: ticks in the middle, or the end of a log that was not closed; else empty.
        gaps: ticks that are missing in the middle.
        parts: the files that were read.
        result: how the job was done, JSON by name; empty in logs that do not say.
    """

    path: Path
    attachments: Mapping[str, bytes]
    metadata: Mapping[str, str]
    outcome: Mapping[str, str]
    ticks: tuple[LoggedTick, ...]
    messages: tuple[Message, ...]
    unfinished: str = ""
    gaps: tuple[Gap, ...] = ()
    parts: tuple[Path, ...] = ()
    result: Mapping[str, str] = field(default_factory=dict)

    @property
    def altered(self) -> bool:
        """Whether something that the run saw was changed in the file; false where the log cannot tell."""
        recorded = self.outcome.get(digest.NAME)
        if recorded is None or self.unfinished or not self.ticks or self.ticks[0].number:
            return False
        return digest.inputs_sha256((message.topic, message.data) for message in self.messages) != recorded

    def __iter__(self) -> Iterator[LogChunk]:
        """All of it, as one chunk, as a LogStream gives many."""
        yield LogChunk(list(self.ticks), list(self.messages))

    @property
    def ticks_of_run(self) -> int:
        """How many ticks the run had, as far as the log knows: more than are here where some are missing."""
        counted = self.outcome.get("ticks", "")
        last = self.ticks[-1].number + 1 if self.ticks else 0
        return max(_whole(counted) or 0, last)

    def begins_at(self, place: int) -> bool:
        """Whether the tick before this place of `ticks` is not in the log: what held until then may hold no more."""
        return not place or self.ticks[place].number != self.ticks[place - 1].number + 1


@dataclass(frozen=True)
class _Part:
    """A file of a log.

    Attributes:
        number: 0 for a log in one file.
        follows: it goes on where the file before it ended.
    """

    path: Path
    content: McapContent
    number: int
    follows: bool


@dataclass(frozen=True)
class LogChunk:
    """What one file of a log holds: whole ticks, and all messages that no file before it had, in order."""

    ticks: list[LoggedTick]
    messages: list[Message]


class LogStream:
    """A log that may be long, read file by file: only one of its parts is in memory.

    Iterate over it once. `attachments` and `metadata` are there with the first chunk, the rest after the last one.

    Attributes:
        path, parts, attachments, metadata, outcome, result, unfinished, gaps: as in Log.
        altered: whether something that the run saw was changed in the file.

    Args:
        path: as for `read_log`.
    """

    def __init__(self, path: Path | Sequence[Path]) -> None:
        self.parts = tuple(files_of(path) if isinstance(path, Path) else path)
        self.path = self.parts[0]
        self.attachments: Mapping[str, bytes] = {}
        self.metadata: Mapping[str, str] = {}
        self.outcome: Mapping[str, str] = {}
        self.result: Mapping[str, str] = {}
        self.unfinished = ""
        self.gaps: tuple[Gap, ...] = ()
        self.altered = False
        self._first_tick: int | None = None

    def __iter__(self) -> Iterator[LogChunk]:
        """Raises LogError where a file cannot be read, is no log of a run, is damaged or lacks a message inside."""
        first = last = None
        remarks: list[str] = []
        inputs = digest.InputDigest()
        ticks = TickBuilder(self.path, any(LOSSY & metadata_of(path).keys() for path in self.parts))
        for part in _parts(self.parts):
            if first is None or last is None:
                first = last = part
                self.attachments, self.metadata = part.content.attachments, part.content.metadata.get("run", {})
                ticks.begin(0 if part.number <= 1 and not part.content.cropped else None)
                ticks.lossy |= bool(part.content.cropped)
            else:
                remarks += _broken_off(last, ticks)
            ticks.lossy |= bool(LOSSY & part.content.metadata.keys())
            chunk = self._chunk(part, ticks, inputs)
            part.content.messages = []
            yield chunk
            last = part
        assert first is not None
        assert last is not None
        self.outcome = last.content.metadata.get("outcome", {})
        self.result = last.content.metadata.get("result", {})
        self.unfinished = "; ".join([*remarks, *_missing(first, last, ticks)])
        self.gaps = tuple(ticks.gaps)
        recorded = self.outcome.get(digest.NAME)
        known = recorded is not None and not self.unfinished and self._first_tick == 0
        self.altered = known and inputs.text() != recorded

    def _chunk(self, part: _Part, ticks: TickBuilder, inputs: digest.InputDigest) -> LogChunk:
        messages = _beyond_head(part.content.messages) if part.follows else part.content.messages
        for message in messages:
            inputs.add(message.topic, message.data)
            if message.encoding == "json":
                ticks.take(message)
        done = ticks.take_away()
        if self._first_tick is None and done:
            self._first_tick = done[0].number
        return LogChunk(done, messages)


def read_log(path: Path | Sequence[Path]) -> Log:
    """Read a whole log; one of a killed process is read up to its last whole tick and says so in `unfinished`.

    Args:
        path: a file; the first part of a rotated log, or the name without a part's number, for all its parts; another
            part for that part alone; or several parts in their order.

    Raises:
        LogError: a file cannot be read, is no log of a run, is damaged or lacks a message in its middle.
    """
    stream = LogStream(path)
    ticks: list[LoggedTick] = []
    messages: list[Message] = []
    for piece in stream:
        ticks += piece.ticks
        messages += piece.messages
    return Log(
        path=stream.path,
        attachments=stream.attachments,
        metadata=stream.metadata,
        outcome=stream.outcome,
        result=stream.result,
        ticks=tuple(ticks),
        messages=tuple(messages),
        unfinished=stream.unfinished,
        gaps=stream.gaps,
        parts=stream.parts,
    )


def json_of(path: Path, values: Mapping[str, str], name: str, make: Callable[[Any], T]) -> T | None:
    """What a value of a log's metadata stands for; None where there is none, or it is null.

    Args:
        path: of the log, for messages.
        make: of plain data; may raise what wrong data make it raise.

    Raises:
        LogError: it does not hold what it should.
    """
    with holding(path, f"{name} in its metadata"):
        found = orjson.loads(values.get(name, "null"))
        return None if found is None else make(found)


def files_of(path: Path) -> list[Path]:
    """The files that a name stands for: itself, or all parts where it is the first part or has no part's number."""
    if part_number(path) is None:
        return [path] if path.exists() else parts_of(path) or [path]
    parts = parts_of(whole_path(path))
    return parts if parts and path == parts[0] else [path]


def refuse_foreign(path: Path) -> None:
    """Raises LogError where an MCAP file says that another program wrote it; one that was not closed may not say."""
    names = metadata_of(path) or ({"run"} if statistics(path) is None else {})
    if (profile := profile_of(path)) not in (PROFILE, None) and "run" not in names:
        raise LogError(path, f"is not a log of this program: an MCAP file with profile {profile!r}")


def _parts(paths: Sequence[Path]) -> Iterator[_Part]:
    before: _Part | None = None
    for path in paths:
        refuse_foreign(path)
        content = read_mcap(path)
        if content.profile not in (PROFILE, None) and "run" not in content.metadata:
            raise LogError(path, f"is not a log of this program: an MCAP file with profile {content.profile!r}")
        if before is None and "run" not in content.metadata and not content.messages:
            raise LogError(path, "holds no run: it ends before the run begins")
        number = _number(path, content)
        if before is not None:
            if not (number and before.number):
                raise LogError(path, "is not part of a rotated log: it cannot be read together with others")
            if number <= before.number:
                raise LogError(path, f"is part {number} and stands after part {before.number}")
            if content.metadata.get("run") != before.content.metadata.get("run"):
                raise LogError(path, f"is a part of another run than {before.path.name}")
        part = _Part(path, content, number, before is not None and number == before.number + 1)
        yield part
        before = part


def _number(path: Path, content: McapContent) -> int:
    text = content.metadata.get("part", {}).get("number", "0")
    number = _whole(text)
    if number is None:
        raise LogError(path, f"has the part number {text[:40]!r}")
    return number


def _whole(text: str) -> int | None:
    """A count; None where the text is none."""
    return int(text) if text.isascii() and text.isdigit() and len(text) <= MOST_DIGITS else None


def _beyond_head(messages: list[Message]) -> list[Message]:
    """Without what a part repeats at its beginning, up to the snapshot."""
    head = next((place for place, message in enumerate(messages) if message.topic == SNAPSHOT), -1)
    return messages[head + 1 :]


def _broken_off(part: _Part, ticks: TickBuilder) -> list[str]:
    """What is missing at the end of a part that others follow."""
    if not part.content.unfinished:
        if ticks.pending is not None:
            raise LogError(part.path, f"tick {ticks.pending} is not whole")
        return []
    ticks.break_off()
    return [f"{part.path.name} {part.content.unfinished}"]


def _missing(first: _Part, last: _Part, ticks: TickBuilder) -> list[str]:
    remarks = [str(gap) for gap in ticks.gaps]
    if cropped := first.content.cropped:
        lost = counted(sum(cropped.values()), "message")
        remarks.append(f"the beginning was cropped: {lost} of {', '.join(sorted(cropped))}")
    had = last.content.metadata.get("outcome", {}).get("ticks", "")
    if ticks.last is not None and ticks.last + 1 < (_whole(had) or 0):
        remarks.append(f"the end was cropped: the run had {had} ticks, the last one here is {ticks.last}")
    if ticks.blind:
        remarks.append(f"{counted(ticks.blind, 'tick')} saw answers of detectors that are missing")
    if last.content.unfinished:
        remarks.append(last.content.unfinished)
    elif "outcome" not in last.content.metadata:
        remarks.append("the run's end is not in it")
    if ticks.pending is not None:
        if not remarks:
            raise LogError(last.path, f"tick {ticks.pending} is not whole")
        remarks.append(f"tick {ticks.pending} is not whole and left out")
    return remarks
