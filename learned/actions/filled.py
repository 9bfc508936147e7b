"""Which holes were empty and are now filled: a second witness of a placement, beside what the hand did."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from cell.interfaces.perception import HoleView
from learned.actions.classes import Classes


@dataclass(frozen=True)
class Filled:
    """A hole that was empty shows a part.

    Attributes:
        part, position: by number, as in `Classes`.
        confidence: that the hole was read right.
    """

    part: int
    position: int
    confidence: float


class FilledHoles:
    """Watches what the holes show, frame after frame.

    Args:
        reads: a part counts when so many new looks in a row show it,
        confidence: and the last one is so sure.
    """

    def __init__(self, classes: Classes, reads: int, confidence: float) -> None:
        self._classes, self._reads, self._least = classes, reads, confidence
        self._seen_s: dict[str, float] = {}
        self._empty: set[str] = set()
        self._shows: dict[str, tuple[str, int]] = {}  # part, and how many looks in a row showed it

    def update(self, holes: Mapping[str, HoleView]) -> Iterator[Filled]:
        """Holes that are newly filled; each once, until it was seen empty again. Old looks count for nothing."""
        for position, view in holes.items():
            if view.seen_s <= self._seen_s.get(position, -1.0):
                continue
            self._seen_s[position] = view.seen_s
            if view.part is None:
                self._empty.add(position)
                self._shows.pop(position, None)
            elif position in self._empty:
                part, looks = self._shows.get(position, (view.part, 0))
                looks = looks + 1 if part == view.part else 1
                self._shows[position] = view.part, looks
                if looks >= self._reads and view.confidence >= self._least:
                    self._empty.discard(position)
                    numbers = self._classes.parts.index(view.part), self._classes.positions.index(position)
                    yield Filled(*numbers, view.confidence)
