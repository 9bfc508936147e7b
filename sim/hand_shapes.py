"""Shapes of the simulated hand, in the hand frame (sim/hand.py): palm and capsules, in [m]."""

from __future__ import annotations

import numpy as np

Segment = tuple[tuple[float, float, float], tuple[float, float, float], float]  # from, to, radius in [m]

PALM_M, PALM_RADII_M = (0.108, 0.037, 0.050), (0.048, 0.043, 0.018)
TIP_RADIUS_M = 0.0075

# Thumb and index finger, written for a closed pinch; each slides outwards along y.
THUMB: tuple[Segment, ...] = (
    ((-0.006, -0.0075, 0.0), (0.012, -0.0075, 0.0), TIP_RADIUS_M),
    ((0.012, -0.0080, 0.001), (0.050, -0.020, 0.020), 0.0090),
    ((0.050, -0.020, 0.020), (0.105, 0.010, 0.042), 0.0120),
)
LONG_THUMB_M = 0.127
INDEX: tuple[Segment, ...] = (
    ((-0.006, 0.0075, 0.0), (0.012, 0.0075, 0.0), TIP_RADIUS_M),
    ((0.012, 0.0078, 0.001), (0.036, 0.012, 0.030), 0.0080),
    ((0.036, 0.012, 0.030), (0.072, 0.010, 0.048), 0.0090),
    ((0.022, 0.0225, 0.006), (0.036, 0.028, 0.032), 0.0075),  # the middle finger, close beside
    ((0.034, 0.028, 0.032), (0.072, 0.032, 0.050), 0.0090),
)
BACK: tuple[Segment, ...] = (
    ((0.076, 0.008, 0.049), (0.090, 0.066, 0.050), 0.0115),  # knuckles
    ((0.085, 0.012, 0.049), (0.135, 0.026, 0.052), 0.0130),  # heel of the thumb
    ((0.068, -0.010, 0.034), (0.100, 0.014, 0.044), 0.0110),  # web of the thumb
    ((0.092, 0.064, 0.050), (0.140, 0.050, 0.053), 0.0120),  # outer edge of the palm
)
CURL_AXIS_M = (0.086, 0.060, 0.051)  # the knuckles that ring and little finger bend at
FINGERS: tuple[Segment, ...] = (
    ((0.046, 0.054, 0.020), (0.052, 0.054, 0.042), 0.0080),  # ring finger
    ((0.052, 0.054, 0.042), (0.082, 0.054, 0.052), 0.0085),
    ((0.062, 0.070, 0.024), (0.066, 0.070, 0.042), 0.0070),  # little finger
    ((0.066, 0.070, 0.042), (0.090, 0.068, 0.050), 0.0075),
)
SLEEVE: Segment = ((0.205, 0.058, 0.072), (0.400, 0.110, 0.140), 0.036)
WRIST: Segment = ((0.135, 0.042, 0.054), (0.205, 0.058, 0.072), 0.027)


def thumb(length_m: float) -> tuple[Segment, ...]:
    """The thumb; a shorter one ends earlier, and meets the palm there."""
    share = length_m / LONG_THUMB_M
    if share == 1:
        return THUMB
    tip, middle, root = THUMB
    start, knuckle, end = (np.array(point) for point in (middle[0], middle[1], root[1]))
    bent, foot = (tuple(float(x) for x in start + share * (point - start)) for point in (knuckle, end))
    return tip, (middle[0], bent, middle[2]), (bent, foot, root[2])  # type: ignore[return-value]
