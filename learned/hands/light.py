"""Images in which hands are easier to find: dark ones are made light, and what should be white is white."""

from __future__ import annotations

import cv2
import numpy as np

from learned.hands.regions import Image

DARK = 70.0  # mean of an image's levels; what is lighter stays as it is
BRIGHTEST = 99.5  # percentage of all levels that is to be no lighter than white
GAMMA = 0.6  # less than 1 lightens the dark most


def levelled(image: Image) -> Image:
    """An RGB image with the channels of one mean and the dark lightened; the same one where it is not dark."""
    levels = image[::2, ::2].reshape(-1, 3).astype(np.float32)
    means = np.maximum(1.0, levels.mean(axis=0))
    if means.mean() >= DARK:
        return image
    gains = means.mean() / means
    top = max(1.0, float(np.percentile(levels * gains, BRIGHTEST)))
    table = 255 * np.clip(np.arange(256)[:, np.newaxis] * gains / top, 0.0, 1.0) ** GAMMA
    return cv2.LUT(image, table.astype(np.uint8)[np.newaxis]).astype(np.uint8, copy=False)
