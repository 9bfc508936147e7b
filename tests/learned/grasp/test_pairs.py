"""Features of pairs against the geometry that they claim to be, and what noise and symmetry do to them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from bracket_cell.learned.grasp.boxes import boxes_of
from bracket_cell.learned.grasp.candidates import as_headed, available
from bracket_cell.learned.grasp.model import PairwisePlanner
from bracket_cell.learned.grasp.pairs import PAIR_FEATURES, Pairs, near_pairs, pair_features
from bracket_cell.learned.grasp.settings import DetectionNoise, GripperOutline, SceneSettings
from bracket_cell.learned.inference.onnx_model import OnnxModel
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.pose import Array
from bracket_lab.learned.grasp.scenes import draw_scenes
from tests.learned.grasp.layouts import PRODUCT, WEIGHTS, moved, standing

EXACT = SceneSettings(noise=DetectionNoise(position_m=0.0, yaw_rad=0.0))
NEAR_GAP, FAR_GAP, ABOVE = 0, 2, 5


def features_of(parts: tuple[PartDetection, ...], noise: DetectionNoise = EXACT.noise) -> tuple[Pairs, Array]:
    boxes = boxes_of(parts, PRODUCT)
    pairs = near_pairs(boxes, available(boxes, GripperOutline()))
    return pairs, pair_features(boxes, pairs, PRODUCT, noise).astype(np.float64)


def test_signed_distances_of_exact_detections_are_the_labels() -> None:
    checked = 0
    for scene in draw_scenes(PRODUCT, 41, 60, "validation", EXACT):
        pairs, features = features_of(scene.parts)
        blocks = as_headed(scene.blocks, scene.boxes, boxes_of(scene.parts, PRODUCT))
        assert features.shape == (len(pairs), PAIR_FEATURES)
        for index, (i, candidate, j) in enumerate(zip(pairs.part, pairs.candidate, pairs.neighbour, strict=True)):
            # The fitting on top cannot be touched: 3 mm of the height, in units of 10 mm.
            touches = features[index, NEAR_GAP] < 0 and features[index, ABOVE] > 0.3
            assert touches == blocks[i, candidate, j]
            assert features[index, NEAR_GAP] <= features[index, FAR_GAP]
            checked += 1
    assert checked > 500


def test_turning_or_mirroring_changes_nothing() -> None:
    parts = (standing("o1", 0.0, 0.0, 0.2), standing("o2", 0.045, 0.02, 1.0), standing("o3", -0.02, 0.07, 2.0))
    expected = features_of(parts)[1]
    assert np.allclose(features_of(tuple(moved(part, 0.3, -0.2, 0.7) for part in parts))[1], expected, atol=1e-5)

    def renamed(numbers: list[int], found: tuple[Pairs, Array]) -> Array:
        """The rows of features as if candidate k were called `numbers[k]`."""
        pairs, features = found
        rows: Array = features[np.lexsort((pairs.neighbour, np.array(numbers)[pairs.candidate], pairs.part))]
        return rows

    half_turns = tuple(
        replace(part, world_from_part=moved(standing(part.part, 0.0, 0.0), x, y, yaw + math.pi).world_from_part)
        for part in parts
        for (x, y, _), yaw in [(part.world_from_part.position_m, part.world_from_part.yaw_rad)]
    )
    assert np.allclose(renamed([0, 1, 4, 5, 2, 3, 7, 6], features_of(half_turns)), expected, atol=1e-5)
    mirrored = tuple(
        standing(part.part, x, -y, -part.world_from_part.yaw_rad)
        for part in parts
        for x, y, _ in [part.world_from_part.position_m]
    )
    assert np.allclose(renamed([0, 1, 2, 5, 4, 3, 7, 6], features_of(mirrored)), expected, atol=1e-5)


def test_more_noise_makes_the_planner_less_sure() -> None:
    model = OnnxModel.load(WEIGHTS / "grasp_pairwise.onnx", "grasp.pairwise")
    gap = GripperOutline().clearance_m + GripperOutline().pad_size_m[0]
    parts = (standing("o3", 0.0, 0.0), standing("o3", 0.0, 0.042 + gap + 0.0025))
    sure, doubtful = (
        PairwisePlanner(model, PRODUCT, noise).plan(parts, 0).graspable
        for noise in (DetectionNoise(), DetectionNoise(position_m=0.005, yaw_rad=math.radians(10)))
    )
    assert sure > 0.95
    assert doubtful < sure - 0.1
