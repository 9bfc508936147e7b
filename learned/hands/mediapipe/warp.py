"""Cutting a square out of an image as OpenCV 4 did, which MediaPipe was built on: places are rounded to 1/32 pixel.

The networks feel it: with exact places, as in OpenCV 5, landmarks differ twice as much from those of MediaPipe.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from learned.hands.regions import Image

STEPS = 32  # in a pixel


def square(image: Image, onto: NDArray[Any], side_px: int, border: int) -> NDArray[np.float32]:
    """A square (1, side, side, 3), 0 to 1.

    Args:
        onto: (2, 3) from pixels of the image to those of the square.
        border: what lies beyond the image, a border type of OpenCV.
    """
    back = cv2.invertAffineTransform(onto.astype(np.float64))
    row, column = np.mgrid[0:side_px, 0:side_px].astype(np.float64)
    places = back[:, 0, None, None] * column + back[:, 1, None, None] * row + back[:, 2, None, None]
    x, y = (np.rint(places * STEPS) / STEPS).astype(np.float32)
    cut = cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=border)
    scaled: NDArray[np.float32] = cut[np.newaxis].astype(np.float32) / np.float32(255)
    return scaled
