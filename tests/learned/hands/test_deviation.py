"""The deviation of a palm grows with what hides it: badly told sizes, darkness; and it is never nothing."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bracket_cell.learned.hands.depth import ERROR_M
from bracket_cell.learned.hands.deviation import WITHIN_HEIGHT, deviation_m
from bracket_cell.learned.hands.reading import ApparentSize, Reading
from bracket_cell.learned.hands.tracking import HandTracks
from bracket_ground.interfaces.perception import WITHIN
from tests.learned.hands.test_tracking import BENCH, VIEW, Script, frame, reading

SIZED = replace(reading((0.8, 0.0)), size=ApparentSize(-3.0, 0.01, (0.02, 0.02)))
LIGHT = np.full((BENCH.overhead.height_px, BENCH.overhead.width_px, 3), 90, np.uint8)


def gloved(level: int) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    """A light bench with a hand of that grey level."""
    image = LIGHT.copy()
    column, row = (round(float(value)) for value in SIZED.points_px["palm"])
    image[row - 12 : row + 13, column - 12 : column + 13] = level
    return image


@given(st.floats(0.003, 0.3), st.floats(1.0, 5.0), st.integers(1, 120), st.integers(1, 120))
def test_it_grows_with_the_error_of_the_size_and_with_darkness(
    error: float, times: float, one: int, other: int
) -> None:
    def of(error: float, level: int, seen: Reading = SIZED) -> tuple[float, float, float]:
        assert seen.size is not None
        return deviation_m(replace(seen, size=replace(seen.size, angle_error=error)), gloved(level), VIEW)

    assert of(error, one)[0] <= of(times * error, one)[0]
    dark, light = sorted((one, other))
    assert all(a >= b > 0 for a, b in zip(of(error, dark), of(error, light), strict=True))


def test_a_hand_of_no_known_size_may_be_farthest_off() -> None:
    assert all(
        a > b
        for a, b in zip(
            deviation_m(replace(SIZED, size=None), LIGHT, VIEW), deviation_m(SIZED, LIGHT, VIEW), strict=True
        )
    )


def test_a_sample_has_it_and_depth_makes_the_height_sure() -> None:
    seen = reading((0.8, 0.0))
    known = HandTracks(BENCH, Script([[seen]] * 2))
    guessed = known.track(frame(0))
    high_m = BENCH.overhead.mount.position_m[2] - 0.15
    depth_mm = np.full(LIGHT.shape[:2], round(1e3 * high_m), np.uint16)
    measured = known.track(replace(frame(1), depth_mm=depth_mm))
    assert guessed is not None
    assert measured is not None
    assert guessed.deviation_m is not None
    assert measured.deviation_m is not None
    assert guessed.deviation_m[2] > measured.deviation_m[2] == ERROR_M
    assert guessed.off_m > measured.off_m > 0  # where it is, too: aside of the camera a wrong height is a wrong place


def test_a_hand_larger_than_trained_may_be_lower_and_elsewhere_than_it_looks() -> None:
    """Twice as large looks half as far away: its height is not known, and its place the less, the farther aside."""
    assert SIZED.size is not None
    usual, larger, largest = (
        deviation_m(replace(SIZED, size=replace(SIZED.size, log_angle=angle)), LIGHT, VIEW) for angle in (-3, -2.5, -2)
    )
    assert usual[0] < larger[0] < largest[0]
    assert 0.1 < larger[2] < largest[2]


@pytest.mark.parametrize("away_m", [0.0, 0.2, 0.4])
def test_a_place_is_as_sure_as_the_height_allows(away_m: float) -> None:
    """Below the camera a wrong height moves nothing; aside of it the place follows, by the slope of the ray."""
    eye_m = np.array(BENCH.overhead.mount.position_m)
    seen = replace(SIZED, points_px=reading((float(eye_m[0]) + away_m, float(eye_m[1]))).points_px)
    across_m, _, tall_m = deviation_m(seen, LIGHT, VIEW)
    flat_m, *_ = deviation_m(seen, LIGHT, VIEW, known_height_m=0.0)
    palm_m = VIEW.on_plane(seen.points_px["palm"][np.newaxis], 0.05)[0]
    slope = math.dist(palm_m, eye_m[:2]) / (eye_m[2] - 0.05)
    by_height_m = WITHIN * math.sqrt(across_m**2 - flat_m**2)
    assert by_height_m == pytest.approx(WITHIN_HEIGHT * slope * tall_m, rel=0.01, abs=1e-6)
