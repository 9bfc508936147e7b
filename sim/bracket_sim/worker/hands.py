"""Several hands at one bracket."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bracket_ground.interfaces.pose import Array

APART_M = 0.12  # between holes at which two hands have room


class Hands:
    """Which hand is at work at which hole, so that several at one bracket keep apart."""

    def __init__(self) -> None:
        self._at: dict[int, tuple[str, str]] = {}  # position and type by number of the hand

    def takes(self, hand: int, position: str, part: str) -> None:
        """A hand goes about filling a hole."""
        self._at[hand] = position, part

    def leaves(self, hand: int) -> None:
        """It is at no hole any more."""
        self._at.pop(hand, None)

    def free(self, hand: int, position: str, part: str, holes_m: Mapping[str, Array]) -> bool:
        """Whether no other hand is near a hole, or fetches parts of the same type."""
        others = [taken for number, taken in self._at.items() if number != hand]
        return all(
            part != theirs and float(np.linalg.norm(holes_m[position] - holes_m[at])) > APART_M for at, theirs in others
        )
