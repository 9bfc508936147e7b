"""Drawn crops: fixed in the part's own frame, mirrored by signs, and different where the surroundings are."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from cell.interfaces.perception import PartDetection
from cell.interfaces.pose import Array
from learned.grasp.boxes import Boxes, boxes_of
from learned.grasp.crops import CROP_FEATURES, crop_embeddings, crop_signs
from tests.learned.grasp.layouts import PRODUCT, moved, standing

PARTS = (standing("o1", 0.0, 0.0, 0.3), standing("o3", 0.012, 0.052, 0.9))


def boxes_seen(parts: tuple[PartDetection, ...]) -> Boxes:
    """Bodies whose edges run through no middle of a crop's cells, where rounding would decide."""
    boxes = boxes_of(parts, PRODUCT)
    return replace(boxes, size_m=boxes.size_m + 0.001)


def crops_of(parts: tuple[PartDetection, ...]) -> Array:
    boxes = boxes_seen(parts)
    return crop_embeddings(boxes, boxes.centre_m, boxes.yaw_rad)


def test_turning_the_scene_changes_no_crop() -> None:
    expected = crops_of(PARTS)
    assert expected.shape == (2, CROP_FEATURES)
    assert np.allclose(crops_of(tuple(moved(part, 0.2, -0.1, 0.8) for part in PARTS)), expected, atol=0.05)


def test_signs_mirror_crops() -> None:
    boxes = boxes_seen(PARTS)
    expected = crop_embeddings(boxes, boxes.centre_m, boxes.yaw_rad)
    turned = crop_embeddings(boxes, boxes.centre_m, boxes.yaw_rad + math.pi)
    assert np.allclose(turned, expected * crop_signs()[3])
    reflected = replace(boxes, centre_m=boxes.centre_m * np.array([1.0, -1.0]), yaw_rad=-boxes.yaw_rad)
    mirrored = crop_embeddings(reflected, reflected.centre_m, reflected.yaw_rad)
    assert np.allclose(mirrored, expected * crop_signs()[2])


def test_neighbours_are_in_the_picture() -> None:
    assert not np.allclose(crops_of(PARTS)[0], crops_of(PARTS[:1])[0])
