"""Across which sides of a body the fingers close, where along them, and how far apart they then are."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

from bracket_ground.interfaces.grasping import OFF_MIDDLE_M, PAD_WIDTH_M
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.product import PartType
from bracket_ground.interfaces.solid import span_m

STROKE_M = 0.085


class Grip(Enum):
    """The pair of a body's sides that the fingers close on, the usual one first."""

    WIDTH = "across the width"
    LENGTH = "across the length"

    @property
    def heading_rad(self) -> float:
        """Direction in which the fingers open, from the body's length."""
        return math.pi / 2 if self is Grip.WIDTH else 0.0

    @property
    def axis(self) -> int:
        """Of the part, along which the fingers close: 0 for x, 1 for y."""
        return 1 if self is Grip.WIDTH else 0

    def span_m(self, kind: PartType) -> float:
        """Distance between the two sides of the box around the body."""
        return kind.size_m[self.axis]

    def top_m(self, kind: PartType) -> float:
        """Height above the body's bottom up to which there is something between the pads."""
        top = span_m(kind.solids, 2, {1 - self.axis: _PADS_M})
        return kind.size_m[2] if top is None else top[1]

    def held_m(self, kind: PartType, fingertips_m: float) -> float:
        """Distance between the pads when they hold the body, the fingertips this far above its bottom."""
        span = span_m(kind.solids, self.axis, {1 - self.axis: _PADS_M, 2: (fingertips_m, math.inf)})
        return self.span_m(kind) if span is None else span[1] - span[0]


@dataclass(frozen=True)
class Hold:
    """How a part is held.

    Attributes:
        grip: the sides that the fingers close on.
        place_m: the pads' middle along these sides, from the part's middle, in the direction of its own axis, when the
            fingers open along `grip.heading_rad` and not half a turn further.
        unsure_m: it may be so much farther on either side.
    """

    grip: Grip
    place_m: float = 0.0
    unsure_m: float = 0.0

    @property
    def part_from_jaw(self) -> Pose:
        """The middle of the pads above the part's origin; its x axis is the direction in which they open."""
        x, y = (self.place_m, 0.0) if self.grip.axis == 1 else (0.0, self.place_m)
        return Pose.from_yaw((x, y, 0.0), self.grip.heading_rad)

    @property
    def turned(self) -> Hold:
        """The same, called from the part's other end."""
        return Hold(self.grip, -self.place_m, self.unsure_m)


def hold_of(grip: Grip, last: Hold | None) -> Hold:
    """How a part is held by a grip: as it was taken last, or, where that is not known, anywhere along its sides."""
    return last if last is not None and last.grip is grip else Hold(grip, unsure_m=OFF_MIDDLE_M[grip.axis])


_PADS_M = (-PAD_WIDTH_M / 2, PAD_WIDTH_M / 2)


def possible_grips(kind: PartType, clearance_m: float) -> tuple[Grip, ...]:
    """Grips for which the stroke leaves this gap between each finger and the box around the body."""
    return tuple(grip for grip in Grip if grip.span_m(kind) + 2 * clearance_m <= STROKE_M)
