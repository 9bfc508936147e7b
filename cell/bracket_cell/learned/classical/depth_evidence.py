"""What stands over the bench by a depth image that is neither the robot nor a hand that was seen.

Colours may hide a hand: a glove as dark as the table, a dark room. A depth image does not. A reference of how high
everything stands grows where neither robot nor hand is; what rises above it and is as thick as an arm is told.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from bracket_cell.learned.classical.box_model import View
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.pose import Array

TILE = 4  # pixels of the image in one of the small image, along both axes
RISES_M = 0.045  # least; a part that was set down is as high, but smaller
FRAMES_VALID = 4  # without robot and hand, until a pixel of the reference counts
REFERENCE_GAIN, REFERENCE_GAIN_RISEN = 1 / 16, 1 / 256  # shares by which the reference follows in a frame
THICK, THICK_SHARE = 9, 0.6  # small pixels: parts are smaller
LEAST_KNOWN = 0.3  # of the image: a camera that knows less is covered, or tells nothing
COVERED = "the depth image shows nothing"


class DepthEvidence:
    """Looks at the depth images of the overhead camera in their order."""

    def __init__(self, bench: Bench) -> None:
        model = bench.overhead.model
        view = View(model, bench.overhead.mount.pose)
        rows, columns = np.mgrid[0 : model.height_px // TILE, 0 : model.width_px // TILE]
        middles = np.stack([columns, rows], axis=-1).reshape(-1, 2) * TILE + (TILE - 1) / 2
        straight = model.normalised(model.straightened(middles))
        rays = np.column_stack([straight, np.ones(len(straight))]) @ view.world_from_camera.rotation.T
        self._falls: Array = rays[:, 2].reshape(rows.shape)  # of a point with its distance from the image plane
        self._top_m = float(view.world_from_camera.position_m[2])
        self._reference: NDArray[np.float32] = np.zeros(rows.shape, np.float32)
        self._frames: NDArray[np.float32] = np.zeros(rows.shape, np.float32)

    def risen(self, depth_mm: NDArray[np.uint16], hidden: NDArray[np.bool_]) -> NDArray[np.bool_] | None:
        """Small pixels where something thick stands that did not stand there; None of an image that tells nothing.

        Args:
            hidden: small pixels that robot or hands may be in front of.
        """
        shape = self._frames.shape
        blocks = depth_mm[: shape[0] * TILE, : shape[1] * TILE].reshape(shape[0], TILE, shape[1], TILE)
        nearest = np.where(blocks > 0, blocks, np.iinfo(np.uint16).max).min(axis=(1, 3))
        known = nearest < np.iinfo(np.uint16).max
        if known.mean() < LEAST_KNOWN:
            return None
        heights = (self._top_m + self._falls * nearest / 1e3).astype(np.float32)
        free = known & ~hidden
        risen = free & (self._frames >= FRAMES_VALID) & (heights - self._reference > RISES_M)
        rate = np.where(risen, np.float32(REFERENCE_GAIN_RISEN), np.float32(REFERENCE_GAIN))
        rate = np.maximum(rate, (self._frames < FRAMES_VALID) / (self._frames + 1)) * free
        self._reference += np.where(free, rate * (heights - self._reference), 0.0).astype(np.float32)
        self._frames += free
        shares = cv2.boxFilter(risen.astype(np.uint8), cv2.CV_32F, (THICK, THICK), borderType=cv2.BORDER_REPLICATE)
        thick: NDArray[np.bool_] = risen & (shares > THICK_SHARE)
        return thick
