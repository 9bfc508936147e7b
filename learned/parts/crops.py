"""Crops of single parts at a fixed scale, turned so that the part's x axis runs to the right."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from cell.interfaces.camera_model import CameraModel
from cell.interfaces.pose import Array, Pose

CROP_PX = (72, 48)  # along the part and across it
STEP_M = 0.0015  # a pixel of the crop on the bench
PLANES = 5  # red, green, blue, and the two of the direction that it is seen from


CORNERS = (np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * (np.array(CROP_PX) - 1) / 2).astype(float)

Crops = NDArray[np.float32]


def crop_of(
    image: NDArray[np.uint8], camera: CameraModel, world_from_camera: Pose, place_m: Array, yaw_rad: float
) -> Crops:
    """What is seen around a place, (PLANES, height, width).

    Args:
        place_m: (3,) the supposed middle of the part's body.
        yaw_rad: the supposed heading of its x axis.

    The two last planes are constant: by how much the camera is off the vertical above the place, along and across.
    """
    crop: Crops = crops_of(image, camera, world_from_camera, [place_m], [yaw_rad])[0]
    return crop


def crops_of(
    image: NDArray[np.uint8],
    camera: CameraModel,
    world_from_camera: Pose,
    places_m: Sequence[Array],
    yaws_rad: Sequence[float],
) -> Crops:
    """`crop_of` several places, (n, PLANES, height, width); a bent lens costs as much for one as for many."""
    turns = np.array([[[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]] for yaw in yaws_rad])
    corners = np.zeros((len(turns), len(CORNERS), 3))
    corners[..., :2] = CORNERS * STEP_M @ turns
    corners += np.array(places_m)[:, np.newaxis]
    seen = camera.project(world_from_camera, corners.reshape(-1, 3)).reshape(len(turns), -1, 2).astype(np.float32)
    width, height = CROP_PX
    own = (CORNERS - CORNERS[0]).astype(np.float32)
    crops = np.empty((len(turns), PLANES, height, width), np.float32)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    for planes, outline, place_m, turn in zip(crops, seen, places_m, turns, strict=True):
        onto = cv2.getPerspectiveTransform(own, outline)
        crop = cv2.warpPerspective(image, onto, CROP_PX, flags=flags, borderMode=cv2.BORDER_REPLICATE)
        planes[:3] = crop.transpose(2, 0, 1) / np.float32(255) - np.float32(0.5)
        way = np.array(world_from_camera.position_m) - place_m
        planes[3:] = (turn @ way[:2] / way[2])[:, np.newaxis, np.newaxis]
    return crops


def half_turned(crops: Crops) -> Crops:
    """What crops (n, PLANES, height, width) were if their parts headed the other way."""
    turned = crops[..., ::-1, ::-1].copy()
    turned[:, 3:] *= -1
    return turned
