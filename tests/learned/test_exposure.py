"""Images of training are taken again in light as warm and by lenses as soft as cells have."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from bracket_cell.learned.inference.exposure import ORDINARY, POOR, SOFT, Camera, spoiled
from bracket_sim.scene.look_range import look_range

GREY = np.full((24, 32, 3), 120, np.uint8)
EDGE = np.repeat(np.where(np.arange(64) < 32, 60, 180)[np.newaxis, :, np.newaxis], 48, 0).repeat(3, 2).astype(np.uint8)


def warmths(camera: Camera) -> NDArray[np.float64]:
    """By how much red is stronger than blue, as a logarithm, in many images."""
    means = [spoiled(GREY, np.random.default_rng(seed), camera=camera).mean(axis=(0, 1)) for seed in range(300)]
    return np.log([(red + 1) / (blue + 1) for red, _, blue in means])


def test_the_white_balance_of_hard_lies_well_within_that_of_poor_cameras() -> None:
    hard = look_range("hard").high.camera, look_range("hard").low.camera
    warmest = float(np.log(hard[0].red_gain / hard[1].blue_gain))
    assert np.mean(warmths(POOR) > warmest) > 0.1 > np.mean(warmths(ORDINARY) > warmest)
    assert np.mean(warmths(POOR) < -warmest) > 0.1


def test_plates_are_seen_as_blurred_as_the_health_of_frames_lets_pass() -> None:
    def steepest(image: NDArray[np.uint8]) -> float:
        line = cv2.GaussianBlur(image.astype(np.float32), (0, 0), 1.5).mean(axis=(0, 2))
        return float(np.abs(np.diff(line)).max() / (line.max() - line.min() + 1))

    softest = steepest(cv2.GaussianBlur(EDGE, (0, 0), 3.2).astype(np.uint8))
    taken = [spoiled(EDGE, np.random.default_rng(seed), camera=SOFT) for seed in range(200)]
    assert any(steepest(image) < softest for image in taken)
    assert np.mean([steepest(image) < 1.5 * softest for image in taken]) < 0.5  # most are sharper
