"""How far off a palm may be, by what is seen of it: its close-up, its darkness, its size.

The networks do not tell it. Its 95 % quantiles were fitted (pinball loss, each person alike) to the errors of the slim
tracker in recordings of validation; `cell lab eval hands` says which share of fresh errors they cover.
"""

from __future__ import annotations

import math

import numpy as np

from bracket_cell.learned.classical.box_model import View
from bracket_cell.learned.hands.reading import Reading
from bracket_cell.learned.inference.prefetch import Image
from bracket_ground.interfaces.perception import WITHIN
from bracket_ground.interfaces.pose import Array

WITHIN_HEIGHT = 1.96  # standard deviations within which 95 % of heights are
USUAL_HEIGHT_ERROR_M = 0.03  # of a height, as close-up and surroundings tell it
UNSIZED = 0.2, 0.1  # errors of size and height [m], of hands that the small networks do not see
HEIGHT_M, OF_BRIGHTNESS = 0.085, -0.26  # 95 % of heights, of a hand as bright as the image; exponent of its brightness
IN_PLANE_M, OF_SIZE_M = 0.008, 0.4  # 95 % of places were the height known: at least, and by the error of the size
PALM_PX, EVERY = 5, 8  # half the width of the window about a palm; every such pixel of the image is looked at
LARGEST_M, HIGH_M = 0.082, 0.25  # palm to wrist of hands that were trained (mean and three deviations); their height
BLACK = 4.0  # grey level that noise makes of black


def deviation_m(
    reading: Reading, image: Image, view: View, known_height_m: float | None = None
) -> tuple[float, float, float]:
    """Standard deviations of a palm along x and y, and of its height.

    A hand that is told too high is told too near to the camera: its place is as sure as its height allows.
    A close-up in which wrist or forearm is hidden tells the size badly; a black glove, or a hand in the dark, is darker
    than the image. A hand that looks larger than any in training is taken for a higher one.

    Args:
        known_height_m: standard deviation of a height that something else tells, as depth does.
    """
    errors = UNSIZED if reading.size is None else (reading.size.angle_error, reading.size.height_errors_m[0])
    tall_m = known_height_m
    if tall_m is None:
        brightness = _brightness(image, reading.points_px["palm"])
        height = max(errors[1] / USUAL_HEIGHT_ERROR_M, 0.1)
        height_m = HEIGHT_M * brightness**OF_BRIGHTNESS * height / WITHIN_HEIGHT
        tall_m = math.hypot(height_m, _taken_for_higher_m(reading, view))
    low, high = (view.on_plane(reading.points_px["palm"][np.newaxis], height_m)[0] for height_m in (0.0, HIGH_M))
    slope = math.dist(low, high) / HIGH_M
    off_m = math.hypot(max(IN_PLANE_M, OF_SIZE_M * errors[0]), WITHIN_HEIGHT * slope * tall_m)
    across_m = off_m / WITHIN
    return across_m, across_m, tall_m


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
