"""Palms in an image: MediaPipe's detector, its anchors, and the averaging of what overlaps."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from bracket_cell.learned.hands.regions import Image
from bracket_cell.learned.inference.onnx_model import OnnxModel
from bracket_ground.interfaces.pose import Array

STEPS = 32  # in a pixel
Tint = tuple[float, float, float]  # factors of red, green and blue
PLAIN: Tint = (1.0, 1.0, 1.0)


def square(image: Image, onto: NDArray[Any], side_px: int, border: int) -> NDArray[np.float32]:
    """A square (1, side, side, 3), 0 to 1.

    Args:
        onto: (2, 3) from pixels of the image to those of the square.
        border: what lies beyond the image, a border type of OpenCV.
    """
    back = cv2.invertAffineTransform(onto.astype(np.float64))
    along = np.arange(side_px, dtype=np.float64)
    places = (along * of_column + along[:, np.newaxis] * of_row + start for of_column, of_row, start in back)
    x, y = ((np.rint(place * STEPS) / STEPS).astype(np.float32) for place in places)
    cut = cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=border)
    scaled: NDArray[np.float32] = cut[np.newaxis].astype(np.float32) / np.float32(255)
    return scaled


INPUT_PX = 192
GRIDS = ((24, 2), (12, 6))  # cells in a row, anchors in a cell
LEAST_SCORE = 0.5
SAME_OVERLAP = 0.3  # intersection over union
LARGEST_LOGIT = 100.0
WRIST, MIDDLE = 0, 2  # of the seven keypoints: wrist, base of the middle finger
SHIFT, SCALE = -0.5, 2.6  # of the region about a palm, in heights of its box


@dataclass(frozen=True, eq=False)
class Roi:
    """A turned square of an image.

    Attributes:
        centre_px: (2,) column and row.
        side_px: its length.
        turn_rad: clockwise on the screen, 0 for fingers up.
    """

    centre_px: Array
    side_px: float
    turn_rad: float

    def outside(self, shares: Array) -> Array:
        """Points (n, 2) of the image from shares of the square, -0.5 to 0.5 from its middle."""
        cosine, sine = math.cos(self.turn_rad), math.sin(self.turn_rad)
        turned: Array = self.side_px * shares @ np.array([[cosine, sine], [-sine, cosine]]) + self.centre_px
        return turned


@dataclass(frozen=True, eq=False)
class Palm:
    """A palm in an image: score, box (centre x, centre y, width, height) and seven keypoints (7, 2), in pixels."""

    score: float
    box_px: Array
    keypoints_px: Array

    @property
    def roi(self) -> Roi:
        """The square that the landmark network looks at."""
        along = self.keypoints_px[MIDDLE] - self.keypoints_px[WRIST]
        turn = wrapped(math.pi / 2 - math.atan2(-along[1], along[0]))
        x, y, width, height = self.box_px
        centre = np.array([x - SHIFT * height * math.sin(turn), y + SHIFT * height * math.cos(turn)])
        return Roi(centre, SCALE * float(max(width, height)), turn)


def find_palms(network: OnnxModel, image: Image, least_score: float = LEAST_SCORE, tint: Tint = PLAIN) -> list[Palm]:
    """All palms in an RGB image, surest first."""
    height, width = image.shape[:2]
    longest = max(width, height)
    answer = network.run({"image": letterbox(image) * np.array(tint, np.float32)})
    raw, logits = answer["Identity"][0].astype(np.float64), answer["Identity_1"][0, :, 0]
    scores = 1 / (1 + np.exp(-np.clip(logits.astype(np.float64), -LARGEST_LOGIT, LARGEST_LOGIT)))
    likely = scores >= least_score
    anchors = ANCHORS[likely]
    values = raw[likely] / INPUT_PX
    middles, sizes = values[:, :2] + anchors, values[:, 2:4]
    corners = np.concatenate([middles - sizes / 2, middles + sizes / 2], axis=1)
    keypoints = values[:, 4:].reshape(-1, 7, 2) + anchors[:, np.newaxis]
    rows = np.concatenate([corners.reshape(-1, 2, 2), keypoints], axis=1)  # (n, 9, 2)
    palms = []
    for score, points in averaged(scores[likely], rows):
        pixels = (points - 0.5) * longest + np.array([width, height]) / 2
        low, high = pixels[:2]
        palms.append(Palm(score, np.concatenate([(low + high) / 2, high - low]), pixels[2:]))
    return palms


def averaged(scores: Array, rows: Array) -> list[tuple[float, Array]]:
    """Weighted non-maximum suppression: what overlaps the best is averaged with it, by scores.

    Args:
        scores: (n,).
        rows: (n, k, 2) points, of which the first two are the corners of a box.
    """
    left = np.argsort(-scores, kind="stable")
    found = []
    while len(left):
        best = left[0]
        same = overlaps(rows[best, :2], rows[left, :2]) > SAME_OVERLAP
        same[0] = True
        group = left[same]
        found.append((float(scores[best]), np.average(rows[group], axis=0, weights=scores[group])))
        left = left[~same]
    return found


def overlaps(box: Array, boxes: Array) -> Array:
    """(n,) Intersection over union of a box (2, 2) with boxes (n, 2, 2)."""
    common = np.prod(np.clip(np.minimum(box[1], boxes[:, 1]) - np.maximum(box[0], boxes[:, 0]), 0, None), axis=1)
    areas = np.prod(np.clip(boxes[:, 1] - boxes[:, 0], 0, None), axis=1)
    union = areas + float(np.prod(np.clip(box[1] - box[0], 0, None))) - common
    shares: Array = np.divide(common, union, out=np.zeros(len(boxes)), where=union > 0)
    return shares


def letterbox(image: Image) -> NDArray[np.float32]:
    """The image within a black square (1, 192, 192, 3), 0 to 1; corners of pixels, not middles, are mapped."""
    height, width = image.shape[:2]
    scale = INPUT_PX / max(width, height)
    shift = (INPUT_PX - scale * np.array([width, height])) / 2
    return square(image, np.array([[scale, 0.0, shift[0]], [0.0, scale, shift[1]]]), INPUT_PX, cv2.BORDER_CONSTANT)


def wrapped(angle_rad: float) -> float:
    """The same angle within +-pi."""
    return math.remainder(angle_rad, 2 * math.pi)


def _anchors() -> Array:
    """(2016, 2) middles of all anchors, row by row."""
    rows = []
    for cells, each in GRIDS:
        line, column = np.mgrid[0:cells, 0:cells]
        middles = np.stack([(column + 0.5) / cells, (line + 0.5) / cells], axis=-1).reshape(-1, 2)
        rows.append(np.repeat(middles, each, axis=0))
    return np.concatenate(rows)


ANCHORS = _anchors()
