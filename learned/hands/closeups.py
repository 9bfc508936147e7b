"""Close-ups of hands: upright, as if all were right ones, and always as large, for the refiner to look at once more."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from cell.interfaces.pose import Array
from learned.hands.regions import POINTS, Image, turning

CLOSE_PX = 96  # side of a close-up
REFINED = POINTS[:-1]  # all but what is held
LENGTH_PX = 27.0  # from palm to wrist in it, if that lay across the view: as large as most hands are seen


@dataclass(frozen=True)
class Closeup:
    """How a close-up lies in the image that it is cut out of.

    Attributes:
        middle: (column, row) of its middle, in that image.
        right_rad: by how much the hand points to the right of that image's upper edge.
        length_px: from palm to wrist in that image, as far as it is known.
        mirrored: it shows a left hand.
    """

    middle: Array
    right_rad: float
    length_px: float
    mirrored: bool

    def cut(self, image: Image) -> Image:
        """The close-up, (96, 96, 3); grey beyond the image."""
        half = np.full(2, (CLOSE_PX - 1) / 2)
        turn = self._step_px * self._turn
        back = np.column_stack([turn, self.middle - turn @ half])
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        cut = cv2.warpAffine(image, back, (CLOSE_PX, CLOSE_PX), flags=flags, borderValue=(110, 110, 110))
        return cut.astype(np.uint8, copy=False)

    def inside(self, points: Array) -> Array:
        """Points (..., 2) of the image as shares of the close-up, 0 to 1."""
        shares: Array = self.aligned(points - self.middle) / (self._step_px * CLOSE_PX) + 0.5
        return shares

    def outside(self, shares: Array) -> Array:
        """The other way round: points of the image."""
        points: Array = (shares - 0.5) * (self._step_px * CLOSE_PX) @ self._turn.T + self.middle
        return points

    def aligned(self, ways: Array) -> Array:
        """Ways (..., 2) in the image, as long, in the directions that they have in the close-up."""
        seen: Array = ways @ self._turn
        return seen

    @property
    def _step_px(self) -> float:
        """Pixels of the image for each of the close-up."""
        return self.length_px / LENGTH_PX

    @property
    def _turn(self) -> Array:
        """(2, 2) from directions in the close-up to those in the image; its inverse is its transpose."""
        turn: Array = turning(self.right_rad) * np.array([-1.0 if self.mirrored else 1.0, 1.0])
        return turn


def middle_of(palm: Array, pinch: Array) -> Array:
    """The point of a hand that a close-up is about: fingertips and wrist are in it."""
    middle: Array = (2 * palm + pinch) / 3
    return middle


def to_the_right_rad(wrist: Array, palm: Array) -> float:
    """By how much a hand points to the right of the image's upper edge."""
    along = palm - wrist
    return math.atan2(along[0], -along[1])
