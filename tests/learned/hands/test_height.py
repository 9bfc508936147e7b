"""A hand's height from its surroundings and from its size, which is learned of each person."""

import math

import numpy as np
import pytest

from bracket_cell.configuration import load_configuration
from bracket_cell.learned.classical.box_model import View
from bracket_cell.learned.hands.height import PalmLength, heights_m, learn_length
from bracket_cell.learned.hands.reading import ApparentSize, Reading

BENCH = load_configuration().bench
VIEW = View(BENCH.overhead.model, BENCH.overhead.mount.pose)
USUAL_M = 0.065
SURE_M, UNSURE_M = 0.004, 0.08
PALM_M = (1.1, 0.3)


def seen(height_m: float, told_m: float, error_m: float, length_m: float, angle_error: float = 0.005) -> Reading:
    """A hand at one height whose surroundings tell another one."""
    palm = VIEW.pixels(np.array([[*PALM_M, height_m]]))[0]
    away_m = float(VIEW.depths(np.array([[*PALM_M, height_m]]))[0])
    size = ApparentSize(math.log(length_m / away_m), angle_error, (error_m, error_m))
    points = {"palm": palm, "pinch": palm - 30.0}
    return Reading(0.9, 0.1, 0.9, points, (0.0, 0.0, 9.0, 9.0), (told_m, told_m - 0.05), size=size)


@pytest.mark.parametrize("share", [0.88, 1.0, 1.15])
def test_the_height_of_a_known_hand_follows_from_its_size(share: float) -> None:
    length = PalmLength(math.log(USUAL_M), 0.1**2)
    for _ in range(60):
        learn_length(seen(0.10, 0.10, SURE_M, share * USUAL_M), VIEW, length)
    assert math.exp(length.log_m) == pytest.approx(share * USUAL_M, rel=0.01)
    palm_m, tips_m = heights_m(seen(0.30, 0.15, UNSURE_M, share * USUAL_M), VIEW, length)
    assert palm_m == pytest.approx(0.30, abs=0.03)
    assert tips_m == pytest.approx(palm_m - 0.05, abs=0.02)


@pytest.mark.parametrize(("angle_error", "height_m"), [(0.008, 0.29), (0.05, 0.17)])
def test_a_clear_size_counts_for_more_than_the_surroundings_and_an_unclear_one_for_less(
    angle_error: float, height_m: float
) -> None:
    length = PalmLength(math.log(USUAL_M), 0.002**2)
    palm_m, _ = heights_m(seen(0.30, 0.16, 0.035, USUAL_M, angle_error), VIEW, length)
    assert palm_m == pytest.approx(height_m, abs=0.015)


def test_of_a_stranger_the_surroundings_count() -> None:
    length, stranger = PalmLength(math.log(USUAL_M), 0.1**2), seen(0.10, 0.10, 0.02, 1.15 * USUAL_M)
    learn_length(stranger, VIEW, length)
    palm_m, _ = heights_m(stranger, VIEW, length)
    assert palm_m == pytest.approx(0.10, abs=0.02)  # by the size of a usual hand it would hang 19 cm higher


def test_what_many_frames_in_a_row_say_counts_as_a_few() -> None:
    length = PalmLength(math.log(USUAL_M), 0.1**2)
    for _ in range(20):
        length.learn(math.log(USUAL_M), 0.02**2)
    assert length.variance > 0.01**2
    for _ in range(100_000):
        length.learn(0.0, 1e6)
    assert length.variance <= 0.1**2


def test_readings_without_a_size_stay_as_they_are() -> None:
    length = PalmLength(math.log(USUAL_M), 0.1**2)
    bare = Reading(0.9, 0.1, 0.9, {"palm": np.array([100.0, 90.0])}, (0.0, 0.0, 9.0, 9.0), (0.12, 0.03))
    learn_length(bare, VIEW, length)
    assert heights_m(bare, VIEW, length) == (0.12, 0.03)
    assert length.variance == pytest.approx(0.1**2)
