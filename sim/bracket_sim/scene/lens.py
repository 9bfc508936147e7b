"""The lens of a simulated camera: a focal length and a distortion that the controller's camera model does not have."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from bracket_ground.interfaces.bench import CameraSetup
from bracket_ground.interfaces.pose import Array
from bracket_sim.scene.look import Camera

ITERATIONS = 12


class Lens:
    """Bends pinhole images: x_d = x (1 + k1 r^2 + k2 r^4) in normalised image coordinates (Brown, 1971).

    Attributes:
        plain: it does nothing.
        rendered_focal_px: focal length to render with, so that the bent image is filled up to its corners.
    """

    def __init__(self, setup: CameraSetup, look: Camera) -> None:
        model = setup.model
        middle = np.array([(setup.width_px - 1) / 2, (setup.height_px - 1) / 2])
        centred = bool((model.middle_px == middle).all()) and model.focals_px[0] == model.focals_px[1]
        self.plain = centred and look.distortion_k1 == look.distortion_k2 == look.focal_error == 0
        self.rendered_focal_px = setup.focal_px
        if self.plain:
            return
        rows, columns = np.mgrid[0 : setup.height_px, 0 : setup.width_px]
        bent = (np.stack([columns, rows], axis=-1) - model.middle_px) / (model.focals_px * (1 + look.focal_error))
        straight = _straightened(bent, look.distortion_k1, look.distortion_k2)
        self.rendered_focal_px = float((middle / np.abs(straight).max(axis=(0, 1))).min())
        self._sources: NDArray[np.float32] = (straight * self.rendered_focal_px + middle).astype(np.float32)

    def bend(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """What the lens makes of an image that was rendered with `rendered_focal_px`."""
        if self.plain:
            return image
        columns, rows = self._sources[..., 0], self._sources[..., 1]
        bent = cv2.remap(image, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return bent.astype(np.uint8, copy=False)

    def bend_nearest(self, depths: NDArray[np.float32]) -> NDArray[np.float32]:
        """The same of values between which there is nothing."""
        if self.plain:
            return depths
        columns, rows = self._sources[..., 0], self._sources[..., 1]
        bent = cv2.remap(depths, columns, rows, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)
        return bent.astype(np.float32, copy=False)


def _straightened(bent: Array, k1: float, k2: float) -> Array:
    """Undistorted coordinates of distorted ones (..., 2), by fixed-point iteration."""
    straight = bent
    for _ in range(ITERATIONS):
        square = (straight**2).sum(axis=-1, keepdims=True)
        straight = bent / (1 + k1 * square + k2 * square**2)
    return straight
