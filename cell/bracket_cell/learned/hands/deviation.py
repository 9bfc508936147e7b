"""How far off a palm may be, by what is seen of it: its close-up, its darkness, its size.

The networks do not tell it. Its 95 % quantiles were fitted (pinball loss, each person alike) to the errors of the slim
tracker in recordings of validation; `cell lab eval hands` says which share of fresh errors they cover.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from bracket_cell.learned.classical.box_model import View
from bracket_cell.learned.hands.reading import Reading
from bracket_cell.learned.inference.prefetch import Image
from bracket_ground.interfaces.perception import WITHIN
from bracket_ground.interfaces.pose import Array

WITHIN_HEIGHT = 1.96  # standard deviations within which 95 % of heights are
USUAL_ERROR, USUAL_HEIGHT_ERROR_M = 0.02, 0.03  # of a size and of a height, as close-up and surroundings tell them
UNSIZED = 0.2, 0.1  # both, of hands that the small networks do not see
PALM_PX, EVERY = 5, 8  # half the width of the window about a palm; every such pixel of the image is looked at
LARGEST_M, HIGH_M = 0.082, 0.25  # palm to wrist of hands that were trained (mean and three deviations); their height
BLACK = 4.0  # grey level that noise makes of black


@dataclass(frozen=True)
class Quantile:
    """95 % of the errors [m] of a hand as bright as the image, whose size is told as well as usual; and exponents."""

    usual_m: float
    size: float
    brightness: float
    height: float


PLACE, HEIGHT = Quantile(0.026, 0.4, -0.12, 0.37), Quantile(0.085, 0.0, -0.26, 1.02)


def deviation_m(reading: Reading, image: Image, view: View) -> tuple[float, float, float]:
    """Standard deviations of a palm along x and y, and of its height.

    A close-up in which wrist or forearm is hidden tells the size badly; a black glove, or a hand in the dark, is darker
    than the image. A hand that looks larger than any in training is taken for a higher one, and so, beside the middle
    of the image, for one that is elsewhere.
    """
    errors = UNSIZED if reading.size is None else (reading.size.angle_error, reading.size.height_errors_m[0])
    size, height = errors[0] / USUAL_ERROR, errors[1] / USUAL_HEIGHT_ERROR_M
    brightness = _brightness(image, reading.points_px["palm"])
    place_m, height_m = (
        quantile.usual_m
        * max(size, 0.1) ** quantile.size
        * brightness**quantile.brightness
        * max(height, 0.1) ** quantile.height
        for quantile in (PLACE, HEIGHT)
    )
    lower_m = _taken_for_higher_m(reading, view)
    slope = float(np.linalg.norm(view.model.normalised(reading.points_px["palm"])))
    across_m = math.hypot(place_m / WITHIN, slope * lower_m)
    return across_m, across_m, math.hypot(height_m / WITHIN_HEIGHT, lower_m)


def _taken_for_higher_m(reading: Reading, view: View) -> float:
    """By how much a hand may be lower than told, as it looks larger than the largest that were trained."""
    away_m = float(view.world_from_camera.position_m[2]) - HIGH_M
    if reading.size is None or away_m <= 0:
        return 0.0
    return away_m * max(0.0, reading.size.log_angle - math.log(LARGEST_M / away_m))


def _brightness(image: Image, palm_px: Array) -> float:
    """Of a palm, by the mean of the image."""
    column, row = (round(float(value)) for value in palm_px)
    rows, columns = (slice(max(0, at - PALM_PX), max(0, at + PALM_PX + 1)) for at in (row, column))
    window = image[rows, columns]
    whole = float(np.mean(image[::EVERY, ::EVERY]))
    return (float(window.mean()) + BLACK) / (whole + BLACK) if window.size else BLACK / (whole + BLACK)
