"""Which holes are empty, and which were and are now filled: a second witness of a placement, beside the hand."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from cell.interfaces.perception import HoleView
from learned.actions.classes import Classes

FRESH_S = 0.2  # age of a look that still tells what is in a hole
FULL_S = 3.0  # a hole that has shown a part for so long is not newly filled: longer than a hand needs over it


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
        reads: a part counts when so many new looks in a row show it.
        confidence: from which on a look settles it.
    """

    def __init__(self, classes: Classes, reads: int, confidence: float) -> None:
        self._classes, self._reads, self._least = classes, reads, confidence
        self._seen_s: dict[str, float] = {}
        self._watched: set[str] = set()  # they were empty once
        self._shows: dict[str, tuple[str, int, bool]] = {}  # part, looks in a row that show it, whether it is settled
        self._full_since_s: dict[str, float] = {}  # first of the looks in a row that show a part upright

    def update(self, holes: Mapping[str, HoleView]) -> Iterator[Filled]:
        """Holes that are newly filled, at each new look up to the one that settles it, and not before they were empty.

        Old looks count for nothing, and a part that leans or lies there is not placed yet.
        """
        for position, view in holes.items():
            if view.seen_s <= self._seen_s.get(position, -1.0):
                continue
            self._seen_s[position] = view.seen_s
            self._note_full(position, view)
            if view.part is None:
                self._watched.add(position)
                self._shows.pop(position, None)
            elif not view.upright:
                self._shows.pop(position, None)
            elif position in self._watched:
                part, looks, settled = self._shows.get(position, (view.part, 0, False))
                looks, settled = (looks + 1, settled) if part == view.part else (1, False)
                sure = looks >= self._reads and view.confidence >= self._least
                self._shows[position] = view.part, looks, settled or sure
                if looks >= self._reads and not settled:
                    numbers = self._classes.parts.index(view.part), self._classes.positions.index(position)
                    yield Filled(*numbers, view.confidence)

    def long_full(self, time_s: float) -> frozenset[int]:
        """Positions, by number, that have shown a part for so long that the hand has placed nothing there just now."""
        full = {position for position, since_s in self._full_since_s.items() if time_s - since_s >= FULL_S}
        return frozenset(number for number, position in enumerate(self._classes.positions) if position in full)

    def _note_full(self, position: str, view: HoleView) -> None:
        """A part that leans may be taken out and placed again without an empty hole being seen."""
        if view.part is None or not view.upright:
            self._full_since_s.pop(position, None)
        else:
            self._full_since_s.setdefault(position, view.seen_s)


def seen_unfilled(classes: Classes, holes: Mapping[str, HoleView], time_s: float) -> frozenset[int]:
    """Positions, by number, in plain view that are empty, or in which a part leans or lies."""
    fresh = {at: view for at, view in holes.items() if time_s - view.seen_s <= FRESH_S}
    shown = {at for at, view in fresh.items() if view.part is None or not view.upright}
    return frozenset(number for number, position in enumerate(classes.positions) if position in shown)
