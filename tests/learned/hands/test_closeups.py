"""Close-ups of hands lie where they say."""

import math

import cv2
import numpy as np
import pytest

from learned.hands.refinement import CLOSE_PX, LENGTH_PX, Closeup, to_the_right_rad


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
