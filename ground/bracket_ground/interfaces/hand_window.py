"""What action detectors look at: the part of an overhead image around the fingertips, or whole frames made small."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bracket_ground.interfaces.bench import CameraSetup
from bracket_ground.interfaces.perception import SEGMENT_FRAMES
from bracket_ground.interfaces.pose import Array

WINDOW_M = 0.24  # side of the square
TIPS_HEIGHT_M = 0.10  # typical, of fingertips over the table
AT_HOLE_M = 0.05  # fingertips so near to a hole, along the bench, may work at it
FRAME_PX = (80, 60)  # (width, height) of whole frames that are made small
EVERY_FRAMES = 3  # of a segment's frames, those that are seen whole


def window_px(camera: CameraSetup) -> int:
    """Side of the window in a camera's images."""
    return round(WINDOW_M * camera.focal_px / (camera.mount.position_m[2] - TIPS_HEIGHT_M))


def hand_window(image: NDArray[np.uint8], tips_px: tuple[float, float], side_px: int) -> NDArray[np.uint8]:
    """(side, side, 3) around the fingertips at (column, row); black beyond the image's edge."""
    height, width = image.shape[:2]
    left, top = (round(value) - side_px // 2 for value in tips_px)
    window = np.zeros((side_px, side_px, 3), np.uint8)
    x0, y0, x1, y1 = max(left, 0), max(top, 0), min(left + side_px, width), min(top + side_px, height)
    if x0 < x1 and y0 < y1:
        window[y0 - top : y1 - top, x0 - left : x1 - left] = image[y0:y1, x0:x1]
    return window


def small_frame(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A whole frame, (60, 80, 3)."""
    import cv2

    return np.asarray(cv2.resize(image, FRAME_PX, interpolation=cv2.INTER_AREA), np.uint8)


def seen_frames(end: int) -> range:
    """Of a segment whose last frame has this number, the numbers of those that are seen whole."""
    return range(end - SEGMENT_FRAMES + EVERY_FRAMES, end + 1, EVERY_FRAMES)


def last_at_hole(fingertips_m: Array, holes_m: Array) -> int | None:
    """The last of n samples (n, 2), NaN where no hand was seen, whose fingertips were at one of the holes (m, 2)."""
    away_m = np.linalg.norm(fingertips_m[:, None, :] - holes_m[None, :, :], axis=2).min(axis=1)
    near = np.flatnonzero(away_m < AT_HOLE_M)  # nothing is nearer than NaN
    return int(near[-1]) if len(near) else None
