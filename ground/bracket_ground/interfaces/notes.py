"""The journal: what nodes report of their beliefs, plans and verdicts; the recorder writes it into the log."""

from __future__ import annotations

from typing import Literal, Protocol

Topic = Literal[
    "belief",
    "plan",
    "verdict",
    "help",
    "skill",
    "bracket",
    "file",
    "message",
    "snapshot",
    "memory",
    "outside",
    "cause",
    "why",
]


class Journal(Protocol):
    """Takes notes of a tick, in the order in which they are made."""

    def note(self, topic: Topic, **fields: object) -> None:
        """Write down one thing; fields hold plain data: numbers, strings, None, sequences and mappings of these."""
        ...


class ListJournal:
    """Keeps notes in a list, for tests and for reading back what one tick reported.

    Attributes:
        notes: (topic, fields) in the order of writing.
    """

    def __init__(self) -> None:
        self.notes: list[tuple[Topic, dict[str, object]]] = []

    def note(self, topic: Topic, **fields: object) -> None:
        self.notes.append((topic, fields))

    def take(self) -> tuple[tuple[Topic, dict[str, object]], ...]:
        """All notes so far; the list begins anew."""
        notes = tuple(self.notes)
        self.notes.clear()
        return notes
