"""Across which sides of a body a gripper holds it, where along them, and how far apart its fingers then are."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

from bracket_ground.interfaces.grasping import OFF_MIDDLE_M, PAD_WIDTH_M
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.product import PartType
from bracket_ground.interfaces.solid import Span, span_m


class Grip(Enum):
    """The sides of a body that it is held by: a pair of them between fingers, the usual one first, or its top."""

    WIDTH = "across the width"
    LENGTH = "across the length"
    TOP = "from above"

    @property
    def heading_rad(self) -> float:
        """Direction in which the fingers open, from the body's length."""
        return math.pi / 2 * self.axis

    @property
    def axis(self) -> int:
        """Of the part, along which the fingers close: 0 for x, 1 for y."""
        return 0 if self is Grip.LENGTH else 1

    def span_m(self, kind: PartType) -> float:
        """Distance between the two sides of the box around the body."""
        return kind.size_m[self.axis]

    def top_m(self, kind: PartType, pads_m: float = PAD_WIDTH_M) -> float:
        """Height above the body's bottom up to which there is something between pads of this width."""
        top = span_m(kind.solids, 2, {1 - self.axis: _middle(pads_m)})
        return kind.size_m[2] if top is None else top[1]

    def held_m(self, kind: PartType, fingertips_m: float, pads_m: float = PAD_WIDTH_M) -> float:
        """Distance between pads of this width that hold the body, the fingertips this far above its bottom."""
        span = span_m(kind.solids, self.axis, {1 - self.axis: _middle(pads_m), 2: (fingertips_m, math.inf)})
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


def _middle(width_m: float) -> Span:
    return -width_m / 2, width_m / 2
