"""Crops of several places at once, and of parts that head the other way."""

from __future__ import annotations

import math

import cv2
import numpy as np

from bracket_cell.learned.parts.maps import CROP_PX, PLANES, crop_of, crops_of, half_turned
from bracket_ground.interfaces.camera_model import CameraModel
from bracket_ground.interfaces.pose import Pose

CAMERA = CameraModel(480, 360, 420.0, -0.1)
ABOVE = Pose((0.5, -0.4, 0.5), (0.0, 1.0, 0.0, 0.0))
NOISE = np.random.default_rng(0).integers(0, 255, (360, 480, 3), np.uint8)
IMAGE = np.asarray(cv2.GaussianBlur(NOISE, (0, 0), 6.0), np.uint8)
PLACES = [np.array([0.5, -0.4, 0.03]), np.array([0.56, -0.33, 0.02])]
YAWS = [0.3, -2.0]


def test_several_crops_at_once_are_those_of_each_place() -> None:
    crops = crops_of(IMAGE, CAMERA, ABOVE, PLACES, YAWS)
    assert crops.shape == (2, PLANES, CROP_PX[1], CROP_PX[0])
    for crop, place, yaw in zip(crops, PLACES, YAWS, strict=True):
        assert np.allclose(crop, crop_of(IMAGE, CAMERA, ABOVE, place, yaw))


def test_a_crop_turned_round_is_that_of_a_part_that_heads_the_other_way() -> None:
    crops = crops_of(IMAGE, CAMERA, ABOVE, PLACES, YAWS)
    other = crops_of(IMAGE, CAMERA, ABOVE, PLACES, [yaw + math.pi for yaw in YAWS])
    assert np.abs(half_turned(crops) - other).max() < 4 / 255
    assert np.abs(crops - other)[:, :3].max() > 12 / 255
