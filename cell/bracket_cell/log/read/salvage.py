"""Salvage of truncated and damaged logs: a complete file of all that is right in one, and what was lost."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bracket_cell.log.read.records import opened
from bracket_cell.log.read.ticks import Gap
from bracket_cell.log.read.walk import PROFILE, McapScanner
from bracket_cell.recording.copying import CopyingWriter
from bracket_cell.recording.parts import part_number
from bracket_ground.errors import LogError
from bracket_ground.files.files import whole_or_none

CHUNK_BYTES = 64 * 1024


@dataclass(frozen=True)
class Loss:
    """What of a log could not be brought back.

    Attributes:
        bytes_skipped: of the damaged file.
        ticks_missing: spans that are not there between 0, in a later part its first tick, and the last tick.
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
        lines = list(self.remarks)
        if self.unclosed:
            lines.append("the log was not closed: what came after its last record is unknown")
        if self.unchecked:
            lines.append("the checksum of the whole does not match")
        lines += [str(gap) for gap in self.ticks_missing]
        for topic, count in self.messages_missing.items():
            lines.append(
                f"{count} messages of {topic!r} are missing" if count > 1 else f"a message of {topic!r} is missing"
            )
        return lines

    def plain(self) -> dict[str, Any]:
        """As JSON: spans as pairs."""
        return {**vars(self), "ticks_missing": [[gap.first, gap.last] for gap in self.ticks_missing]}


def recover(path: Path, out: Path) -> Loss:
    """Write what can be salvaged of one file of a log as a complete file; only a chunk of it is in memory.

    Messages of own logs are numbered anew; the loss stands in the metadata `recovered`.

    Raises:
        LogError: the log cannot be read, holds nothing of an MCAP file, or the new file cannot be written.
    """
    try:
        with opened(path) as data, whole_or_none(out) as partial, partial.open("wb") as stream:
            writer = CopyingWriter(stream, CHUNK_BYTES)
            walk = McapScanner(data, writer)
            writer.renumber = walk.profile == PROFILE
            writer.start(walk.profile or "", "cell log export --to recovered")
            walk.run()
            loss = _loss(walk, part_number(path) or 1)
            if not any(walk.kept.values()) and (loss.lossy or not walk.begins):
                raise LogError(path, "holds nothing that can be salvaged")
            if loss.lossy:
                writer.note("recovered", {name: json.dumps(value) for name, value in loss.plain().items()})
            writer.finish()
    except OSError as error:
        raise LogError(out, f"cannot be written: {error.strerror or error}") from None
    return loss


def _loss(walk: McapScanner, part: int) -> Loss:
    profile = walk.profile or ""
    return Loss(
        bytes_skipped=walk.skipped,
        ticks_missing=tuple(_gaps(sorted(walk.ticks), 0 if part == 1 or not walk.ticks else min(walk.ticks)[0])),
        messages_missing=dict(walk.missing),
        unclosed=not (walk.closed and walk.ends),
        unchecked=walk.unchecked,
        remarks=tuple(walk.remarks),
        foreign="" if walk.of_run else f"an MCAP file with profile {profile!r}, but not a log of this program",
    )


def _gaps(spans: list[list[int]], expected: int) -> Iterator[Gap]:
    """What is missing from a tick to the last of spans in order."""
    for first, last in spans:
        if first > expected:
            yield Gap(expected, first - 1)
        expected = max(expected, last + 1)
