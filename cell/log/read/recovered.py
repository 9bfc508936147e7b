"""What was found in a damaged log, and what was lost."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from mcap.records import Attachment, Channel, Metadata, Schema

from cell.log.read.mcap_file import PROFILE


@dataclass(frozen=True)
class Loss:
    """What of a log could not be brought back.

    Attributes:
        bytes_skipped: of the damaged file.
        ticks_missing: numbers that are not there between the first and the last tick.
        messages_missing: by topic, from the numbers that messages have in their channel.
        unclosed: the end is missing; what came after the last record is unknown.
        unchecked: the file's own checksum tells of a change in a place that no other checksum covers.
        remarks: one line for each damaged place.
        foreign: what it is, where it is an MCAP file of another program; empty for logs of this one.
    """

    bytes_skipped: int
    ticks_missing: tuple[int, ...]
    messages_missing: Mapping[str, int]
    unclosed: bool
    unchecked: bool
    remarks: tuple[str, ...]
    foreign: str = ""

    @property
    def lossy(self) -> bool:
        return bool(self.bytes_skipped or self.ticks_missing or self.messages_missing or self.remarks) or (
            self.unclosed or self.unchecked
        )

    def lines(self) -> list[str]:
        """What was lost, for people."""
        told = list(self.remarks)
        if self.unclosed:
            told.append("the log was not closed: what came after its last record is unknown")
        if self.unchecked:
            told.append("the checksum of the whole does not match")
        if ticks := self.ticks_missing:
            told.append(f"{len(ticks)} ticks missing, from {ticks[0]} to {ticks[-1]}")
        told += [f"{count} messages of {topic} missing" for topic, count in self.messages_missing.items()]
        return told


class RecoveredMessage(NamedTuple):
    """A message with its channel's number and its own number in that channel."""

    channel: int
    sequence: int
    time_ns: int
    published_ns: int
    data: bytes


@dataclass
class Salvage:
    """What was found in a file, in the order of writing; records are those of the `mcap` package.

    Attributes:
        profile: what the writer calls its kind of file.
    """

    path: Path
    profile: str = ""
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    messages: list[RecoveredMessage] = field(default_factory=list)
    attachments: list[Attachment] = field(default_factory=list)
    metadata: list[Metadata] = field(default_factory=list)
    loss: Loss = field(default_factory=lambda: Loss(0, (), {}, False, False, ()))


def foreign(found: Salvage) -> str:
    """What a file is that this program did not write; empty where it did, also where the head is lost that says so."""
    topics = {channel.topic for channel in found.channels.values()}
    if found.profile == PROFILE or "/tick" in topics or any(one.name == "run" for one in found.metadata):
        return ""
    return f"an MCAP file with profile {found.profile!r}, but not a log of this program"


def missing_ticks(found: Salvage) -> Iterator[int]:
    """Gaps between 0 and the last number on /tick; a number beyond the count of messages is damage, not a gap."""
    of_tick = {number for number, channel in found.channels.items() if channel.topic == "/tick"}
    seen = set()
    for one in found.messages:
        if one.channel in of_tick:
            try:
                number = json.loads(one.data)["tick"]
            except (ValueError, KeyError, TypeError):
                continue
            if isinstance(number, int) and 0 <= number < 10**7:
                seen.add(number)
    return (number for number in range(max(seen, default=-1)) if number not in seen)


def missing_messages(found: Salvage) -> dict[str, int]:
    """Messages that are missing, by topic; only this program's own logs number all messages of a channel."""
    if found.profile != PROFILE:
        return {}
    last: dict[int, int] = {}
    missing: dict[str, int] = {}
    for one in found.messages:
        gap = one.sequence - last.get(one.channel, 0) - 1
        last[one.channel] = one.sequence
        if gap and one.channel in found.channels:
            topic = found.channels[one.channel].topic
            missing[topic] = missing.get(topic, 0) + abs(gap)
    return missing
