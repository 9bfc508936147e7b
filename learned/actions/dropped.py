"""Parts that the hand let fall into a hole: it held one over the hole, and now the part stands there without the hand.

Fingers that open well over a hole look as if the hand only passed there, to a detector that learned from parts that are
put into their holes.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cell.interfaces.perception import HandSample, HoleView
from cell.interfaces.pose import Array
from learned.actions.classes import Classes
from learned.actions.filled import FRESH_S, Filled

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
