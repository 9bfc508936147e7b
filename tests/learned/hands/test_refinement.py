"""What a closer look changes of a reading, and what it leaves as it is."""

import math
from collections.abc import Mapping
from typing import cast

import cv2
import numpy as np
import pytest

from bracket_cell.configuration import load_configuration
from bracket_cell.learned.hands.model import NEW_CONFIDENCE
from bracket_cell.learned.hands.reading import ApparentSize, Reading
from bracket_cell.learned.hands.refinement import (
    CLOSE_PX,
    LENGTH_PX,
    REFINED,
    UNCLEAR,
    Closeup,
    Refinement,
    to_the_right_rad,
)
from bracket_cell.learned.hands.regions import Regions
from bracket_cell.learned.hands.tracking import LEAST_CONFIDENCE
from bracket_cell.learned.inference.onnx_model import Network
from bracket_ground.interfaces.pose import Array

SURE, RATIO = 0.99, 0.1


class _Told:
    """A network that tells of every close-up the same: points in its middle, a larger hand, and how sure that is."""

    def __init__(self, error: float) -> None:
        self.error = error

    def run(self, inputs: Mapping[str, Array]) -> dict[str, Array]:
        rows = len(inputs["closeup"])
        told = {"points": np.full((rows, len(REFINED), 2), 0.5), "log_ratio": np.full(rows, RATIO)}
        return {**told, "error": np.full(rows, self.error)}


def _readings(error: float, sized: bool = True) -> tuple[Reading, Reading]:
    """A hand in the middle of an image, as it was read and after a closer look."""
    regions = Regions.of(load_configuration().bench.overhead)
    middle = np.array(regions.size_px) / 2
    away = {"palm": (0, 10), "wrist": (0, 60), "pinch": (0, -40), "thumb": (-10, -40), "index": (10, -40)}
    points = {name: middle + offset for name, offset in away.items()}
    size = ApparentSize(math.log(0.05), 0.03, (0.01, 0.01)) if sized else None
    read = Reading(SURE, 0.0, 1.0, points, (0.0, 0.0, 1.0, 1.0), (0.1, 0.1), size=size)
    image = np.full((int(regions.size_px[1]), int(regions.size_px[0]), 3), 90, np.uint8)
    return read, Refinement(regions, cast(Network, _Told(error))).refined(image, [read])[0]


def test_a_clear_closeup_tells_size_and_points() -> None:
    read, refined = _readings(UNCLEAR / 2)
    assert read.size is not None
    assert refined.size == ApparentSize(read.size.log_angle + RATIO, UNCLEAR / 2, read.size.height_errors_m)
    assert not np.allclose(refined.points_px["palm"], read.points_px["palm"])
    assert refined.confidence == SURE


@pytest.mark.parametrize("error", [UNCLEAR, 0.2])
def test_an_unclear_closeup_changes_nothing_but_begins_no_hand(error: float) -> None:
    read, refined = _readings(error)
    assert refined.size == read.size
    assert all(np.array_equal(refined.points_px[name], at) for name, at in read.points_px.items())
    assert LEAST_CONFIDENCE < refined.confidence < NEW_CONFIDENCE, "a hand that was seen before goes on"


def test_a_reading_without_a_size_stays_as_it_is() -> None:
    read, refined = _readings(UNCLEAR / 2, sized=False)
    assert refined is read


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("right_rad", [0.0, 0.7, -2.0])
def test_what_is_cut_out_lies_where_the_closeup_says(right_rad: float, mirrored: bool) -> None:
    image = np.zeros((200, 240, 3), np.uint8)
    dot = np.array([131.0, 92.0])
    cv2.circle(image, (131, 92), 3, (255, 255, 255), -1)
    closeup = Closeup(np.array([120.0, 100.0]), right_rad, 33.0, mirrored)
    cut = closeup.cut(image)[..., 0].astype(float)
    lines, columns = np.mgrid[0:CLOSE_PX, 0:CLOSE_PX] + 0.5
    seen = np.array([(columns * cut).sum(), (lines * cut).sum()]) / cut.sum() / CLOSE_PX
    assert np.allclose(seen, closeup.inside(dot), atol=0.003)
    assert np.allclose(closeup.outside(closeup.inside(dot)), dot)


@pytest.mark.parametrize("mirrored", [False, True])
def test_a_hand_is_upright_and_always_as_large(mirrored: bool) -> None:
    wrist, palm = np.array([80.0, 90.0]), np.array([110.0, 50.0])
    closeup = Closeup(palm, to_the_right_rad(wrist, palm), 50.0, mirrored)
    away = (closeup.inside(wrist) - closeup.inside(palm)) * CLOSE_PX
    assert np.allclose(away, (0.0, LENGTH_PX))
    assert math.isclose(float(np.linalg.norm(closeup.aligned(wrist - palm))), 50.0)
