"""Where along a part's sides the fingers may close on it, for skills, labels, rule and trained planners alike."""

from __future__ import annotations

import math

from bracket_ground.interfaces.product import PartType
from bracket_ground.interfaces.solid import Span, span_m

PAD_WIDTH_M = 0.025  # of usual fingertips; narrower ones hold in the middle alone
OFF_MIDDLE_M = (0.014, 0.010)
"""How far the pads' middle may be from the middle of a part's sides: of its ends, where the fingers close along x, and
of its long sides. On these the part's own middle stays between the pads, as many parts are round there: farther off,
some were dropped in simulation."""
_SHARES = ((0.0, 0.5, -0.5, 1.0, -1.0), (0.0, 1.0, -1.0))  # of that; half of the way on long sides adds next to nothing

_SURE_M = 0.002  # what holds is so far inside of the pads' edges, because of errors of detector and arm
_ALIKE_M = 1e-4


def places_m(axis: int) -> tuple[float, ...]:
    """Middle of the pads along the sides that they close on, from the middle of these; the nearest to it first.

    Args:
        axis: of the part, along which the fingers close: 0 for x, 1 for y.
    """
    return tuple(share * OFF_MIDDLE_M[axis] for share in _SHARES[axis])


def held_off_middle(kind: PartType, axis: int, fingertips_m: float) -> bool:
    """Whether fingers beside the middle close on the same sides, as far apart, as in the middle.

    A part whose middle is narrower than its ends would be held by one end alone.

    Args:
        axis: as in `places_m`.
        fingertips_m: their height above the body's bottom.
    """

    def between(low_m: float, high_m: float) -> Span | None:
        return span_m(kind.solids, axis, {1 - axis: (low_m, high_m), 2: (fingertips_m, math.inf)})

    half, off = PAD_WIDTH_M / 2, OFF_MIDDLE_M[axis]
    middle = between(-half, half)
    others = [between(place - half + _SURE_M, place + half - _SURE_M) for place in places_m(axis) if place != 0.0]
    others.append(between(-off - half, off + half))
    return middle is not None and all(other is not None and math.dist(other, middle) < _ALIKE_M for other in others)
