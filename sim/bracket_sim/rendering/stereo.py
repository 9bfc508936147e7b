"""The depth image of a stereo camera, as an Intel RealSense D435i sends it: spoilt as matching left to right spoils it.

The error of a depth is that of the disparity, so it grows with the square of the distance, and neighbours share it as
they share a matching window, which also makes what is near wider than it is. Nothing is matched where only one of the
two cameras looks, and here and there for want of texture.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from bracket_ground.interfaces.bench import CameraSetup
from bracket_sim.scene.lens import Lens
from bracket_sim.scene.look import Camera

BASELINE_M, FOCAL_PX = 0.050, 425.0  # of the stereo pair at 848 x 480
DISPARITY_PX = 0.08  # standard deviation of a matched pixel on a textured surface
SCALE_SPREAD = 0.005  # of the calibration, drawn once
WINDOW_PX, FATTENED_PX = 4.0, 2  # pixels that share an error; by so much the foreground is wider
LOST_FROM, LOST_PX = 1.88, 3.0  # standard deviations: 3 % of pixels, in blobs of so many
COARSE = 2  # pixels, along both axes, for which noise is drawn once
FARTHEST_M = 10.0

DepthImage = NDArray[np.uint16]


class Stereo:
    """Spoils clean depths; the same depths in the same order come out the same.

    Args:
        rng: this sensor's alone.
    """

    def __init__(self, setup: CameraSetup, look: Camera, rng: np.random.Generator) -> None:
        self._rng, self._lens = rng, Lens(setup, look)
        self._shift_px = setup.focal_px * BASELINE_M  # disparity at 1 m, in pixels of the colour image
        self._scale = 1 + float(rng.normal(0.0, SCALE_SPREAD))

    def spoil(self, depths_m: NDArray[np.float32]) -> DepthImage:
        """What the camera sends, in [mm], pixel by pixel as the colour image; 0 where it knows nothing.

        Args:
            depths_m: (height, width) true distances from the image plane, by a pinhole camera.
        """
        seen = self._lens.bend_nearest(depths_m)
        window = np.ones((2 * FATTENED_PX + 1,) * 2, np.uint8)
        near = np.asarray(cv2.erode(seen, window), np.float32)
        error = near**2 * DISPARITY_PX / (FOCAL_PX * BASELINE_M)
        told = near * self._scale + error * self._smooth(near.shape, WINDOW_PX / 2)
        blobs = self._smooth(near.shape, LOST_PX)
        lost = (blobs > LOST_FROM) | self._one_eyed(seen) | (told > FARTHEST_M)
        millimetres = np.where(lost, 0.0, np.rint(1e3 * told)).astype(np.uint16)
        millimetres.setflags(write=False)
        return millimetres

    def _smooth(self, shape: tuple[int, ...], sigma_px: float) -> NDArray[np.float32]:
        """Noise with standard deviation 1, alike within some pixels."""
        coarse = [-(-side // COARSE) for side in shape]
        noise = self._rng.standard_normal(coarse, dtype=np.float32)
        smooth = cv2.GaussianBlur(noise, (0, 0), sigma_px / COARSE)
        whole = np.asarray(cv2.resize(smooth, shape[::-1], interpolation=cv2.INTER_LINEAR), np.float32)
        found: NDArray[np.float32] = whole / whole.std()
        return found

    def _one_eyed(self, depths_m: NDArray[np.float32]) -> NDArray[np.bool_]:
        """Where something nearer stands before the second camera: to the left of its edge."""
        columns = np.arange(depths_m.shape[1]) - self._shift_px / depths_m
        from_right = np.minimum.accumulate(columns[:, ::-1], axis=1)[:, ::-1]
        hidden = np.zeros(depths_m.shape, bool)
        hidden[:, :-1] = from_right[:, 1:] < columns[:, :-1]
        return hidden
