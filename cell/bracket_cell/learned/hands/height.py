"""How high a hand is, from two opinions: what is around it, and how large it looks once the person's hand is known.

People's hands differ by a tenth, which in one image looks like 13 cm of height. But a person keeps the same hand: where
the surroundings tell its height well (fingers at a hole, a hand on the table), its length follows from its apparent
size, and later its height from its length.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from bracket_cell.learned.classical.box_model import View
from bracket_cell.learned.hands.reading import ApparentSize, Reading, over_table
from bracket_ground.interfaces.pose import Array

LAPLACE = math.sqrt(2)  # standard deviation of a Laplace distribution, over its mean absolute error
# The network's errors of the size differ too little: the true ones grow with their square, and are the same here.
TRUE_ANGLE_ERROR = 0.0143
# What is around a hand draws it to the height that is usual, in all frames alike: such errors count for larger ones.
AROUND_TIMES = 1.7
ALIKE_FRAMES = 10  # this many frames in a row err alike, and count as one
FORGETS = 2e-7  # variance of the logarithm that is added with each frame: another person may come
HIGH_M = 0.3  # any two heights tell how distance goes with height
BEND_M = 0.006  # standard deviation of how much higher the palm is than the fingertips


@dataclass
class PalmLength:
    """What is known of the length from a person's palm to the wrist: a normal distribution of its logarithm in [m]."""

    log_m: float
    variance: float
    largest: float = field(init=False)

    def __post_init__(self) -> None:
        self.largest = self.variance

    def learn(self, log_m: float, variance: float) -> None:
        """One more measurement, whose neighbours in time err alike."""
        self.variance = min(self.largest, self.variance + FORGETS)
        gain = self.variance / (self.variance + ALIKE_FRAMES * variance)
        self.log_m += gain * (log_m - self.log_m)
        self.variance *= 1 - gain


def learn_length(reading: Reading, view: View, length: PalmLength) -> None:
    """Learn a person's length from the height that the surroundings tell, as far as they are sure of it."""
    if reading.size is None:
        return
    palm_sd, tips_sd = _around_sds(reading.size)
    # By the fingertips, too: at a hole they are known better than the palm.
    around_m, around_sd = _mean((reading.heights_m[0], palm_sd), (reading.heights_m[0], math.hypot(tips_sd, BEND_M)))
    away_m = _Depths(view, reading.points_px["palm"]).away_m(around_m)
    length.learn(reading.size.log_angle + math.log(away_m), _angle_sd(reading.size) ** 2 + (around_sd / away_m) ** 2)


def heights_m(reading: Reading, view: View, length: PalmLength) -> tuple[float, float]:
    """Heights of palm and fingertips over the table, of a hand of that length."""
    palm_m, tips_m = reading.heights_m
    if reading.size is None:
        return palm_m, tips_m
    palm_sd, tips_sd = _around_sds(reading.size)
    far_m = math.exp(length.log_m - reading.size.log_angle)
    by_size_m = _Depths(view, reading.points_px["palm"]).height_m(far_m)
    by_size_sd = far_m * math.hypot(_angle_sd(reading.size), math.sqrt(length.variance))
    height_m, sd = _mean((palm_m, palm_sd), (by_size_m, by_size_sd))
    tips, _ = _mean((tips_m, tips_sd), (height_m + tips_m - palm_m, math.hypot(sd, BEND_M)))
    return over_table(height_m), over_table(tips)


def _around_sds(size: ApparentSize) -> tuple[float, float]:
    """Standard deviations in [m] of the heights of palm and fingertips that the surroundings tell."""
    palm_m, tips_m = (AROUND_TIMES * LAPLACE * error for error in size.height_errors_m)
    return palm_m, tips_m


def _angle_sd(size: ApparentSize) -> float:
    """Standard deviation of the logarithm of the size."""
    return LAPLACE * size.angle_error**2 / TRUE_ANGLE_ERROR


class _Depths:
    """Distance from the camera's image plane and height over the table, along the line of sight of one pixel."""

    def __init__(self, view: View, pixel: Array) -> None:
        points = [[*view.on_plane(pixel[np.newaxis], height_m)[0], height_m] for height_m in (0.0, HIGH_M)]
        self._table_m, high_m = (float(depth) for depth in view.depths(np.array(points)))
        self._each_m = (high_m - self._table_m) / HIGH_M

    def away_m(self, height_m: float) -> float:
        return self._table_m + self._each_m * height_m

    def height_m(self, away_m: float) -> float:
        return (away_m - self._table_m) / self._each_m


def _mean(one: tuple[float, float], other: tuple[float, float]) -> tuple[float, float]:
    """Two measurements (value, standard deviation) as one."""
    weights = one[1] ** -2, other[1] ** -2
    total = sum(weights)
    return (weights[0] * one[0] + weights[1] * other[0]) / total, total**-0.5
