"""Crops of holes at a fixed scale, cut out of the plate as if seen from straight above."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from cell.interfaces.bench import Bench
from cell.interfaces.camera_model import CameraModel
from cell.interfaces.pose import Array, Pose
from cell.interfaces.product import Product

CROP_PX = 48
STEP_M = 0.002  # a pixel of the crop on the plate

_CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])


def squares_m(bench: Bench, product: Product) -> Array:
    """Corners (holes, 4, 3) of the square on the plate around each hole, in the world."""
    half_m = (CROP_PX - 1) / 2 * STEP_M
    holes = np.array(list(product.bracket.holes_m.values()))
    corners = holes[:, np.newaxis] + half_m * _CORNERS
    flat = np.concatenate([corners.reshape(-1, 2), np.zeros((4 * len(holes), 1))], axis=1)
    return bench.bracket.pose.transform(flat).reshape(-1, 4, 3)


def hole_crops(
    image: NDArray[np.uint8], camera: CameraModel, world_from_camera: Pose, squares: Array
) -> NDArray[np.float32]:
    """What is seen in each square, (holes, 3, CROP_PX, CROP_PX) from -0.5 to 0.5; what is out of view repeats the edge.

    Args:
        squares: (holes, 4, 3) from `squares_m`.
    """
    turns = _turns(camera, world_from_camera, squares)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    flat = np.empty((len(turns), CROP_PX, CROP_PX, 3), np.uint8)
    for crop, turn in zip(flat, turns, strict=True):
        cv2.warpPerspective(image, turn, (CROP_PX, CROP_PX), crop, flags, cv2.BORDER_REPLICATE)
    crops: NDArray[np.float32] = flat.transpose(0, 3, 1, 2).astype(np.float32, order="C")
    crops /= np.float32(255)
    crops -= np.float32(0.5)
    return crops


def _turns(camera: CameraModel, world_from_camera: Pose, squares: Array) -> list[Array]:
    """From pixels of each crop to those of the image, (3, 3)."""
    pixels = camera.project(world_from_camera, squares.reshape(-1, 3)).reshape(-1, 4, 2).astype(np.float32)
    own = ((_CORNERS + 1) / 2 * (CROP_PX - 1)).astype(np.float32)
    return [np.asarray(cv2.getPerspectiveTransform(own, seen), np.float64) for seen in pixels]
