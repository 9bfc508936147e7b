"""Where thumb and index finger take a part that stands."""

from __future__ import annotations

from functools import cache, lru_cache

import numpy as np

from cell.interfaces.product import PartType
from cell.interfaces.solid import span_m

HEIGHT_M = (0.010, 0.035)  # least and most above the body's bottom, else half its height
FROM_BOTTOM_M, FROM_TOP_M = 0.008, 0.004  # the same where a part is taken at any height
FROM_END = 0.16  # of the body's length, so that the part protrudes ahead of the fingertips
LENGTH_M = 0.012  # of the fingers, ahead of and behind the pinch, that lies against the part
STEP_M = 0.001
TIP_M = 0.003  # radius of a tool's tip


@cache
def widest_near_end(part: PartType) -> tuple[tuple[float, float, float], float]:
    """A place near the part's end, at the height where it is widest, the nearest to half its height.

    Returns:
        The place in the part's frame and how wide the part is there, in [m].
    """
    length_m, _, height_m = part.size_m
    low_m, high_m = HEIGHT_M
    return _widest(part, length_m * (0.5 - FROM_END), min(max(height_m / 2, low_m), high_m), HEIGHT_M)


@lru_cache(maxsize=512)
def widest(part: PartType, from_middle_m: float) -> tuple[tuple[float, float, float], float]:
    """The same at a distance from the part's middle, at any height."""
    length_m, _, height_m = part.size_m
    x_m = min(from_middle_m, length_m * (0.5 - FROM_END))
    return _widest(part, x_m, height_m / 2, (FROM_BOTTOM_M, height_m - FROM_TOP_M))


@lru_cache(maxsize=512)
def top_m(part: PartType, from_middle_m: float) -> float:
    """How high the part reaches above its bottom on its long axis, where a tool's tip comes down."""
    window = (from_middle_m - TIP_M, from_middle_m + TIP_M)
    _, high = span_m(part.solids, 2, {0: window, 1: (-TIP_M, TIP_M)}) or (0.0, part.size_m[2])
    return high


def _widest(
    part: PartType, x_m: float, middle_m: float, heights_m: tuple[float, float]
) -> tuple[tuple[float, float, float], float]:
    low_m, high_m = heights_m
    along = (x_m - LENGTH_M, x_m + LENGTH_M)
    steps = np.arange(round((low_m - middle_m) / STEP_M), round((high_m - middle_m) / STEP_M) + 1)
    best_m, widest_m = middle_m, 0.0
    for step in sorted(steps, key=abs):
        z_m = middle_m + float(step) * STEP_M
        low, high = span_m(part.solids, 1, {0: along, 2: (z_m, z_m)}) or (0.0, 0.0)
        if high - low > widest_m + 1e-9:
            best_m, widest_m = z_m, high - low
    return (x_m, 0.0, best_m), widest_m or part.size_m[1]
