"""What the centre net is to say about an image is read back as it was: encode, then decode."""

from __future__ import annotations

import math

import numpy as np

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.learned.inference.exposure import levelled
from bracket_cell.learned.parts.maps import (
    CELLS,
    FURTHER,
    HEIGHT_UNIT_M,
    MOST_PEAKS,
    UPRIGHT,
    network_input,
    overlap,
    peaks,
)
from bracket_ground.interfaces.camera_model import CameraModel
from bracket_ground.interfaces.pose import Pose
from bracket_lab.learned.parts.augment import sample
from bracket_lab.learned.parts.data import Label, Scene
from bracket_lab.learned.parts.evaluate import Findings, average_precision, judge

CONFIGURATION = load_configuration()
PRODUCT = load_product(CONFIGURATION)
TYPES = tuple(PRODUCT.parts)
FLOOR_M = 0.004
CAMERA = CameraModel(480, 360, 420.0)
ABOVE = Pose((0.5, -0.4, 0.5), (0.0, 1.0, 0.0, 0.0))
SCALE = 1.5  # of the camera's image against the network's


def label(part: str, x: float, y: float, angle: float, upright: bool) -> Label:
    outline = np.array([[x - 30, y - 20], [x + 36, y - 20], [x + 36, y + 26], [x - 30, y + 26]])
    axis = 8 * np.array([math.cos(angle), math.sin(angle)])
    return Label(part, Pose((0.5, -0.4, FLOOR_M + 0.012)), upright, outline, np.array([x, y]), axis, 0.6)


def scene(*labels: Label) -> Scene:
    image = np.full((360, 480, 3), 90, np.uint8)
    return Scene("one", image, CAMERA, ABOVE, ABOVE, labels)


def test_labels_are_read_back_as_they_were() -> None:
    labels = (label(TYPES[0], 101.0, 80.0, 0.4, True), label(TYPES[2], 300.5, 250.25, -1.0, False))
    drawn = sample(scene(*labels), TYPES, FLOOR_M, None)
    drawn.further[UPRIGHT] = np.where(drawn.further[UPRIGHT] > 0.5, 5.0, -5.0)  # as logits
    found = sorted(peaks(drawn.heat, drawn.further, 0.9), key=lambda peak: peak.kind)
    assert [peak.kind for peak in found] == [0, 2]
    for peak, true in zip(found, labels, strict=True):
        centre = (true.centre_px + 0.5) / SCALE - 0.5
        assert np.abs(peak.centre_px - centre).max() < 1e-3
        assert overlap(peak.box_px, (true.box_px + 0.5) / SCALE - 0.5) > 0.99
        angle = math.atan2(true.axis_px[1], true.axis_px[0])
        assert math.cos(2 * (peak.axis_rad - angle)) > 0.9999
        assert abs(peak.height_m - 0.012) < 1e-6 * HEIGHT_UNIT_M + 1e-6
        assert (peak.upright > 0.5) == true.upright


def test_an_image_is_sampled_as_in_training() -> None:
    plain = scene()
    image = np.random.default_rng(0).integers(60, 120, plain.image.shape, np.uint8)  # sharp edges everywhere
    told = sample(Scene(plain.log, image, plain.camera, ABOVE, ABOVE, ()), TYPES, FLOOR_M, None)
    asked = network_input(levelled(image))[0]
    assert np.abs(asked - told.image).max() < 3 / 255


def test_a_turned_image_moves_its_labels_along() -> None:
    true = label(TYPES[1], 240.0, 180.0, 0.3, True)
    plain = scene(true)
    image = plain.image.copy()
    image[170:190, 230:250] = (250, 20, 20)
    marked = Scene(plain.log, image, plain.camera, plain.world_from_camera, plain.believed, plain.labels)
    for seed in range(8):
        drawn = sample(marked, TYPES, FLOOR_M, np.random.default_rng(seed))
        found = peaks(drawn.heat, drawn.further, 0.9)
        if not found:
            continue
        column, row = np.rint(found[0].centre_px).astype(int)
        red, green, _ = drawn.image[:, row, column]
        bare = drawn.image[:, 5, 5]
        assert red - green > (bare[0] - bare[1]) or np.allclose(red, green, atol=0.12), seed


def test_average_precision_of_perfect_half_and_useless_detectors() -> None:
    assert average_precision([(0.9, True), (0.8, True)], 2) == 1.0
    assert average_precision([(0.9, True)], 2) == 0.5
    assert average_precision([(0.9, False), (0.8, True)], 1) == 0.5
    assert average_precision([(0.9, False)], 1) == 0.0
    assert average_precision([], 3) == 0.0


def test_types_that_are_not_in_the_images_do_not_count() -> None:
    findings = Findings()
    judge(scene(label(TYPES[0], 101.0, 80.0, 0.4, True)), (), PRODUCT, findings)
    scores = findings.scores(PRODUCT)
    assert scores["map_50"] == scores["map_50_95"] == 0.0
    assert "ap_50_unknown" not in scores
    assert all(math.isfinite(value) for value in scores.values())


def test_a_thing_of_doubtful_type_is_told_once_for_each() -> None:
    drawn = sample(scene(label(TYPES[0], 101.0, 80.0, 0.4, True), label(TYPES[2], 103.0, 81.0, 0.4, True)), TYPES,
                   FLOOR_M, None)  # fmt: skip
    found = peaks(drawn.heat, drawn.further, 0.5)
    assert sorted(peak.kind for peak in found) == [0, 2]


def test_a_network_that_sees_something_everywhere_gives_no_more_than_the_surest() -> None:
    rng = np.random.default_rng(1)
    heat = rng.uniform(0.2, 0.9, (4, *reversed(CELLS))).astype(np.float32)
    found = peaks(heat, np.zeros((FURTHER, *reversed(CELLS)), np.float32), 0.1)
    assert len(found) == MOST_PEAKS
    scores = [peak.score for peak in found]
    assert scores == sorted(scores, reverse=True)
    assert scores[0] == heat.max()
