"""The 21 landmarks of one hand: MediaPipe's network on a turned square of the image."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from cell.interfaces.pose import Array
from learned.hands.mediapipe.palms import Roi, square, wrapped
from learned.hands.regions import Image
from learned.inference.onnx_model import OnnxModel

INPUT_PX = 224
LEAST_PRESENCE = 0.5
OF_PALM = (0, 1, 2, 3, 5, 6, 9, 10, 13, 14, 17, 18)  # what the next region is made from
WRIST, THUMB_TIP, INDEX_TIP = 0, 4, 8
INDEX_BASE, MIDDLE_BASE, RING_BASE, LITTLE_BASE = 5, 9, 13, 17
SHIFT, SCALE = -0.1, 2.0


@dataclass(frozen=True)
class Landmarks:
    """A hand in an image.

    Attributes:
        points_px: (21, 2) column and row: wrist, then four each of thumb, index, middle, ring and little finger.
        world_m: (21, 3) about the hand's middle, as the network guesses its size.
        presence: from 0 to 1.
        left: probability that it is a left hand, as one sees it: not mirrored like a selfie.
    """

    points_px: Array
    world_m: Array
    presence: float
    left: float

    @property
    def roi(self) -> Roi:
        """The square in which it should be in the next image."""
        points = self.points_px
        towards = ((points[INDEX_BASE] + points[RING_BASE]) / 2 + points[MIDDLE_BASE]) / 2 - points[WRIST]
        turn = wrapped(math.pi / 2 - math.atan2(-towards[1], towards[0]))
        cosine, sine = math.cos(turn), math.sin(turn)
        back = np.array([[cosine, -sine], [sine, cosine]])
        straight = points[list(OF_PALM)] @ back
        low, high = straight.min(axis=0), straight.max(axis=0)
        width, height = high - low
        centre = ((low + high) / 2 + np.array([0.0, SHIFT * height])) @ back.T
        return Roi(centre, SCALE * float(max(width, height)), turn)


def read_landmarks(network: OnnxModel, image: Image, roi: Roi) -> Landmarks:
    """The hand in a square of an RGB image; its presence says whether there is one."""
    answer = network.run({"image": warped(image, roi)})
    points = answer["Identity"].astype(np.float64).reshape(21, 3)
    return Landmarks(
        points_px=roi.outside(points[:, :2] / INPUT_PX - 0.5),
        world_m=answer["Identity_3"].astype(np.float64).reshape(21, 3),
        presence=float(answer["Identity_1"].item()),
        left=1 - float(answer["Identity_2"].item()),
    )


def warped(image: Image, roi: Roi) -> NDArray[np.float32]:
    """A square (1, 224, 224, 3), 0 to 1, corner to corner; beyond the image its edge goes on."""
    corners = roi.outside(np.array([[-0.5, -0.5], [0.5, -0.5], [-0.5, 0.5]])).astype(np.float32)
    onto = cv2.getAffineTransform(corners, np.array([[0, 0], [INPUT_PX, 0], [0, INPUT_PX]], np.float32))
    return square(image, onto, INPUT_PX, cv2.BORDER_REPLICATE)
