"""Parts that the hand let fall into a hole: it held one over the hole, and now the part stands there without the hand.

Fingers that open well over a hole look as if the hand only passed there, to a detector that learned from parts that are
put into their holes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from bracket_cell.learned.actions.settings import Classes
from bracket_ground.interfaces.perception import HandSample, HoleView
from bracket_ground.interfaces.pose import Array

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
        reads: a part counts when this many new looks in a row show it.
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


OVER_M = 0.03  # from hole to fingertips: the hand is over it
AWAY_M = 0.045  # and from here on it is not
FALLS_S = 1.5  # so long after the hand held a part over a hole, that may be what stands there
CONFIDENCE = 0.9  # of the look that shows it


class DroppedParts:
    """Watches what the hand holds, and where, and what the holes show after.

    Args:
        holes_m: (positions, 2) where they are on the bench, in the order of the product.
    """

    def __init__(self, classes: Classes, holes_m: Array) -> None:
        self._classes, self._holes_m = classes, holes_m
        self._held_s: dict[tuple[str, int], float] = {}  # when a part was last held over a position

    def update(self, time_s: float, hand: HandSample | None, holes: Mapping[str, HoleView]) -> list[Filled]:
        """Holes in which a part stands that the hand held over them just before, and that the hand has left.

        A hand that is not seen may be anywhere, so it has left none.
        """
        if hand is None:
            return []
        away_m = np.linalg.norm(self._holes_m - hand.fingertips_m, axis=1)
        if hand.held_part is not None:
            for number in np.flatnonzero(away_m < OVER_M).tolist():
                self._held_s[hand.held_part, number] = time_s
        return [
            Filled(self._classes.parts.index(view.part), number, view.confidence)
            for number, position in enumerate(self._classes.positions)
            if away_m[number] > AWAY_M
            and (view := holes.get(position)) is not None
            and view.part is not None
            and _stands(view, time_s)
            and time_s - self._held_s.get((view.part, number), -np.inf) <= FALLS_S
        ]


def _stands(view: HoleView, time_s: float) -> bool:
    return view.upright and view.confidence >= CONFIDENCE and time_s - view.seen_s <= FRESH_S
