"""What in an image is the robot itself, by where the cell knows it to be, and whether it explains a hand that is read.

Robots cannot hide a hand by this: a hand counts as explained only where its palm and fingertips lie on the robot, the
reader is not sure of it, and no hand is found where the robot is painted over.
"""

from __future__ import annotations

from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from bracket_cell.learned.classical.box_model import View, fill, outline
from bracket_cell.learned.hands.reading import HandReader, Reading
from bracket_cell.learned.hands.regions import Image
from bracket_ground.interfaces.frame import Frame

SURE = 0.99  # a reader that is so sure is believed: true hands have more, the gripper has less
BEYOND_M = 0.05  # so far beside the robot's outline a point still lies on it: palms are also seen in its shadow
EDGE_PX, GAP_PX = 3, 10  # so far beside the outline, and so far from both sides of a gap, is the robot, too
RING_PX = 15  # the robot is painted in the colour of what is around it
LEAST_DEPTH_M = 0.05  # links nearer to the camera are not drawn
LEFT_CONFIDENCE = 0.5  # of what is read where the robot is painted over: a hand is left


class RobotMask:
    """The robot in one frame.

    Args:
        near_px: readings so near to each other are of one hand.
    """

    def __init__(self, frame: Frame, view: View, reader: HandReader, near_px: float) -> None:
        self._image, self._robot_m, self._view = frame.image, frame.robot_m, view
        self._reader, self._near_px = reader, near_px

    def under(self, reading: Reading) -> bool:
        """Whether palm and fingertips lie on the robot; False if the robot's place is unknown."""
        if self._robot_m is None:
            return False
        height, width = self._mask.shape
        points = np.array([reading.points_px["palm"], reading.points_px["pinch"]]).round().astype(int)
        columns, rows = points[:, 0].clip(0, width - 1), points[:, 1].clip(0, height - 1)
        return bool(self._outline[rows, columns].all())

    def explains(self, reading: Reading) -> bool:
        """Whether a reading is nothing but the robot."""
        return reading.confidence < SURE and self.under(reading) and not self._left(reading)

    def _left(self, reading: Reading) -> bool:
        """Whether a hand is found there without the robot, too, by a reader that is not told where to look."""
        found = self._reader.read(self._painted, [])
        return any(
            other.confidence >= LEFT_CONFIDENCE
            and float(np.linalg.norm(other.centre_px - reading.centre_px)) < self._near_px
            for other in found
        )

    @cached_property
    def _mask(self) -> NDArray[np.uint8]:
        """1 where a link is, (height, width)."""
        height, width = self._image.shape[:2]
        mask = np.zeros((height, width), np.uint8)
        for points in () if self._robot_m is None else self._robot_m:
            if float(self._view.depths(points).min()) > LEAST_DEPTH_M:
                mask |= fill((height, width), outline(self._view.pixels(points)))
        return mask

    @cached_property
    def _outline(self) -> NDArray[np.uint8]:
        """The mask with what is right beside it."""
        assert self._robot_m is not None
        middle = self._robot_m.reshape(-1, 3).mean(axis=0).tolist()
        return cv2.dilate(self._mask, _disc(round(BEYOND_M * self._view.pixels_per_m(middle)))).astype(np.uint8)

    @cached_property
    def _painted(self) -> Image:
        """The image without the robot, and without what is between two pieces of it, as the holder of its camera."""
        covered = cv2.morphologyEx(cv2.dilate(self._mask, _disc(EDGE_PX)), cv2.MORPH_CLOSE, _disc(GAP_PX)) > 0
        ring = (cv2.dilate(self._mask, _disc(RING_PX)) > 0) & ~covered
        painted = self._image.copy()
        painted[covered] = np.median(painted[ring], axis=0) if ring.any() else painted.mean(axis=(0, 1))
        return painted


def _disc(radius_px: int) -> NDArray[np.uint8]:
    size = 2 * radius_px + 1
    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size)).astype(np.uint8)
