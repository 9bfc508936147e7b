"""Images that are turned, and what is true of them: people's hands seldom point to the side by themselves."""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from cell.interfaces.pose import Array
from learned.hands.regions import turning

TURNED_SHARE = 0.4  # of training images
LARGEST_TURN_RAD = math.pi / 2


def drawn_turns(count: int, rng: np.random.Generator) -> Array:
    """(count,) Angles [rad] from right to down of training images; some stay as they are."""
    chosen = rng.random(count) < TURNED_SHARE
    angles: Array = rng.uniform(-LARGEST_TURN_RAD, LARGEST_TURN_RAD, count) * chosen
    return angles


def turned_images(images: NDArray[np.uint8], turns: Array) -> NDArray[np.uint8]:
    """Images (n, height, width, 3), each turned about its middle; what comes in continues their edges."""
    height, width = images.shape[1:3]
    middle = (np.array([width, height]) - 1) / 2
    answer = images.copy()
    for row in np.flatnonzero(turns):
        turn = turning(turns[row])
        there = np.column_stack([turn, middle - turn @ middle])
        answer[row] = cv2.warpAffine(images[row], there, (width, height), borderMode=cv2.BORDER_REPLICATE)
    return answer


def turned_points(points: Array, turns: Array, size: Sequence[float] | Array = (1.0, 1.0)) -> Array:
    """Points (n, ..., 2) about the middle of an image, each row turned.

    Args:
        turns: (n,) [rad].
        size: (width, height) of the image, where points are shares of it.
    """
    turn = np.array([turning(angle) for angle in turns]).reshape(len(turns), 2, 2)
    moved: Array = np.einsum("nij,n...j->n...i", turn, points * np.asarray(size)) / np.asarray(size)
    return moved
