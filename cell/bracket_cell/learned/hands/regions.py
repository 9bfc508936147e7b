"""Which part of an overhead image the networks look at: all of it, made small, to find hands; a square around each.

A region is as large as a hand with what it holds, whatever the camera: REGION_M at REGION_HEIGHT_M over the table. Its
surroundings are a coarser square about the same place, which shows the forearm and shadows of a lifted hand.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from bracket_ground.interfaces.bench import CameraSetup
from bracket_ground.interfaces.pose import Array

FINDER_PX = (160, 120)  # (width, height) of the whole image as the finder sees it
CELL_PX = 8  # of the finder's answer, in its image
REGION_PX = 128  # side of a region as the reader sees it
PATCH_PX = REGION_PX + 64  # side of a region with the room that it is shifted in
AROUND_PX = 96  # side of the surroundings, in pixels of the finder's image
REGION_M, REGION_HEIGHT_M = 0.32, 0.10
POINTS = ("palm", "pinch", "thumb", "index", "wrist", "radial", "ulnar", "held")

Image = NDArray[np.uint8]


@dataclass(frozen=True)
class Regions:
    """Regions of the images of one camera.

    Attributes:
        width_px, height_px: size of its images.
        side_px: of a region in them.
        focal_px: of the camera.
        middle_px: its principal point (column, row).
    """

    width_px: int
    height_px: int
    side_px: float
    focal_px: float
    middle_px: tuple[float, float]

    @staticmethod
    def of(setup: CameraSetup) -> Regions:
        """For a camera that looks down on the table."""
        depth_m = setup.mount.position_m[2] - REGION_HEIGHT_M
        side_px, (column, row) = REGION_M * setup.focal_px / depth_m, setup.model.middle_px.tolist()
        return Regions(setup.width_px, setup.height_px, side_px, setup.focal_px, (column, row))

    @property
    def size_px(self) -> Array:
        """(width, height) of the images."""
        return np.array([self.width_px, self.height_px], dtype=np.float64)

    def small(self, image: Image) -> Image:
        """The whole image as the finder sees it, (120, 160, 3)."""
        return cv2.resize(image, FINDER_PX, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)

    def cut(self, image: Image, centre_px: Array, side_px: int = REGION_PX) -> Image:
        """The region around a point (column, row), (side, side, 3); grey beyond the image.

        Args:
            side_px: of the answer; more than REGION_PX takes a larger region at the same scale.
        """
        scale = self.side_px / REGION_PX
        smooth = cv2.GaussianBlur(image, (0, 0), 0.35 * scale) if scale > 1.5 else image
        return _warped(smooth, _seen_from(centre_px, scale, side_px), side_px)

    def around(self, small: Image, centre_px: Array, shift_px: float | Array = 0.0, scale: float = 1.0) -> Image:
        """The surroundings of a point (column, row), (AROUND_PX, AROUND_PX, 3), of the image as the finder sees it.

        Args:
            shift_px: (right, down), of the region in its own pixels.
            scale: by which it is seen larger.
        """
        middle = self._in_small(centre_px + shift_px * self.side_px / REGION_PX)
        return _warped(small, _seen_from(middle, 1 / scale, AROUND_PX), AROUND_PX)

    def _in_small(self, point_px: Array) -> Array:
        shares: Array = (point_px + 0.5) / self.size_px
        return shares * FINDER_PX - 0.5

    def inside(self, points_px: Array, centre_px: Array) -> Array:
        """Points (..., 2) of the image as shares of the region around a point, 0 to 1."""
        shares: Array = (points_px - centre_px) / self.side_px + 0.5
        return shares

    def outside(self, shares: Array, centre_px: Array) -> Array:
        """The other way round: points of the image from shares of the region."""
        points: Array = (shares - 0.5) * self.side_px + centre_px
        return points

    def from_middle(self, point_px: Array) -> Array:
        """The way (2,) to a point of the image from the principal point, by the focal length: how askew it is seen."""
        way: Array = (point_px - np.array(self.middle_px)) / self.focal_px
        return way

    def place(self, centre_px: Array) -> Array:
        """Where in the image a region is, (2,), 0 in the middle and +-1 at the edges."""
        place: Array = 2 * (centre_px + 0.5) / self.size_px - 1
        return place


def _seen_from(middle: Array, step_px: float, side_px: int) -> Array:
    """The affine map (2, 3) from pixels of a square to those of the image that it is cut out of.

    Args:
        middle: (column, row) of the square, in the image.
        step_px: of the image, for each pixel of the square.
        side_px: of the square.
    """
    return np.column_stack([step_px * np.eye(2), middle - step_px * (side_px - 1) / 2])


def turning(angle_rad: float) -> Array:
    """The matrix (2, 2) that turns points (column, row) from right to down."""
    cos, sin = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[cos, -sin], [sin, cos]])


def _warped(image: Image | NDArray[Any], back: Array, side_px: int) -> Image:
    """A square (side, side, 3) of an image; grey beyond it."""
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    cut = cv2.warpAffine(image, back, (side_px, side_px), flags=flags, borderValue=(110, 110, 110))
    return cut.astype(np.uint8, copy=False)


def planes(images: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Images (n, height, width, 3) as a network takes them: (n, 3, height, width), 0 to 1."""
    scaled: NDArray[np.float32] = images.transpose(0, 3, 1, 2).astype(np.float32, order="C") / np.float32(255)
    return scaled


def centre_of(palm_px: Array, pinch_px: Array) -> Array:
    """The point of a hand that the finder finds and the reader is centred on."""
    centre: Array = (palm_px + pinch_px) / 2
    return centre
