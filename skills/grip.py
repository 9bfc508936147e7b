"""Across which sides of a body the fingers close, and how the fingers tell it of a part that they hold."""

from __future__ import annotations

import math
from enum import Enum

from cell.interfaces.product import PartType

STROKE_M = 0.085


class Grip(Enum):
    """The pair of a body's sides that the fingers close on, the usual one first."""

    WIDTH = "across the width"
    LENGTH = "across the length"

    @property
    def heading_rad(self) -> float:
        """Direction in which the fingers open, from the body's length."""
        return math.pi / 2 if self is Grip.WIDTH else 0.0

    def span_m(self, kind: PartType) -> float:
        """Distance between the two sides."""
        return kind.size_m[1] if self is Grip.WIDTH else kind.size_m[0]


def possible_grips(kind: PartType, clearance_m: float) -> tuple[Grip, ...]:
    """Grips for which the stroke leaves this gap between each finger and the body."""
    return tuple(grip for grip in Grip if grip.span_m(kind) + 2 * clearance_m <= STROKE_M)


def grip_of(kind: PartType, opening_m: float) -> Grip:
    """How a part is held, by the distance between the fingers; WIDTH where its sides are alike."""
    return min(Grip, key=lambda grip: abs(grip.span_m(kind) - opening_m))
