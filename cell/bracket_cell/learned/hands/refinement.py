"""A closer look at hands that were read: the refiner sees each in a close-up, and tells its size and points anew."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from bracket_cell.learned.hands.reading import ApparentSize, Reading
from bracket_cell.learned.hands.regions import PATCH_PX, POINTS, REGION_PX, Image, Regions, planes, turning
from bracket_cell.learned.inference.onnx_model import Network
from bracket_ground.interfaces.pose import Array

CLOSE_PX = 96  # side of a close-up
REFINED = POINTS[:-1]  # all but what is held
LENGTH_PX = 27.0  # from palm to wrist in it, if that lay across the view: as large as most hands are seen


@dataclass(frozen=True, eq=False)
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


PATCH_MIDDLE = (PATCH_PX - 1) / 2
# Share by which a size may err. Close-ups that tell it worse show hands that are covered, or too dark: their points are
# no better than those read before, nor like what action detectors learned from; and most of what is no hand is so.
UNCLEAR = 0.07
DOUBTED = 0.9  # confidence of such readings at most: enough to go on following a hand, too little to begin


class Refinement:
    """Refines readings of the images of one camera."""

    def __init__(self, regions: Regions, network: Network) -> None:
        self._regions, self._network = regions, network

    def refined(self, image: Image, readings: Sequence[Reading]) -> list[Reading]:
        """The readings, with points and size as the close-ups show them.

        Those without a size stay as they are; those whose close-up is unclear are believed less.
        """
        sized = [(index, reading, reading.size) for index, reading in enumerate(readings) if reading.size is not None]
        if not sized:
            return list(readings)
        closeups = [self._closeup(reading, size.log_angle) for _, reading, size in sized]
        patches = [self._regions.cut(image, reading.centre_px, PATCH_PX) for _, reading, _ in sized]
        cuts = np.stack([closeup.cut(patch) for closeup, patch in zip(closeups, patches, strict=True)])
        ways = [self._regions.from_middle(reading.centre_px) for _, reading, _ in sized]
        places = np.array([closeup.aligned(way) for closeup, way in zip(closeups, ways, strict=True)], np.float32)
        output = self._network.run({"closeup": planes(cuts), "place": places})
        answer = list(readings)
        for row, (index, reading, size) in enumerate(sized):
            error = float(output["error"][row])
            if error >= UNCLEAR:
                answer[index] = replace(reading, confidence=min(reading.confidence, DOUBTED))
                continue
            points = self._in_image(closeups[row].outside(output["points"][row].astype(float)), reading.centre_px)
            answer[index] = replace(
                reading,
                points_px={**reading.points_px, **dict(zip(REFINED, points, strict=True))},
                size=ApparentSize(size.log_angle + float(output["log_ratio"][row]), error, size.height_errors_m),
            )
        return answer

    def _closeup(self, reading: Reading, log_angle: float) -> Closeup:
        """How a hand that was read lies in the patch about its centre."""
        wrist, palm, pinch = (reading.points_px[name] for name in ("wrist", "palm", "pinch"))
        scale = REGION_PX / self._regions.side_px
        length_px = math.exp(log_angle) * self._regions.focal_px * scale
        middle = (middle_of(palm, pinch) - reading.centre_px) * scale + PATCH_MIDDLE
        return Closeup(middle, to_the_right_rad(wrist, palm), length_px, reading.left > 0.5)

    def _in_image(self, points: Array, centre_px: Array) -> Array:
        """Points (n, 2) of the image, from those of the patch about a centre."""
        there: Array = (points - PATCH_MIDDLE) * self._regions.side_px / REGION_PX + centre_px
        return there
