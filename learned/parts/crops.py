"""Crops of single parts at a fixed scale, turned so that the part's x axis runs to the right."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from cell.interfaces.camera_model import CameraModel
from cell.interfaces.pose import Array, Pose

CROP_PX = (72, 48)  # along the part and across it
STEP_M = 0.0015  # a pixel of the crop on the bench
PLANES = 5  # red, green, blue, and the two of the direction that it is seen from


def crop_of(
    image: NDArray[np.uint8], camera: CameraModel, world_from_camera: Pose, place_m: Array, yaw_rad: float
) -> NDArray[np.float32]:
    """What is seen around a place, (PLANES, height, width).

    Args:
        place_m: (3,) the supposed middle of the part's body.
        yaw_rad: the supposed heading of its x axis.

    The two last planes are constant: by how much the camera is off the vertical above the place, along and across.
    """
    cosine, sine = np.cos(yaw_rad), np.sin(yaw_rad)
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * (np.array(CROP_PX) - 1) / 2 * STEP_M
    offsets = corners @ np.array([[cosine, sine], [-sine, cosine]])
    seen = camera.project(world_from_camera, np.column_stack([offsets, np.zeros(4)]) + place_m)
    width, height = CROP_PX
    own = np.array([[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]], np.float32)
    turn = cv2.getPerspectiveTransform(own, seen.astype(np.float32))
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    crop = cv2.warpPerspective(image, turn, CROP_PX, flags=flags, borderMode=cv2.BORDER_REPLICATE)
    planes = np.empty((PLANES, height, width), np.float32)
    planes[:3] = crop.transpose(2, 0, 1) / np.float32(255) - np.float32(0.5)
    way = np.array(world_from_camera.position_m) - place_m
    planes[3] = (way[0] * cosine + way[1] * sine) / way[2]
    planes[4] = (way[1] * cosine - way[0] * sine) / way[2]
    return planes
