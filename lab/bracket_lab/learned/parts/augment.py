"""Training images of the centre net: turned, scaled and lit at random, with the maps that it is to give."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from bracket_cell.learned.inference.exposure import POOR, levelled, spoiled
from bracket_cell.learned.parts.maps import (
    AXIS,
    BOX,
    BOX_UNIT_PX,
    CELLS,
    FURTHER,
    HEIGHT,
    HEIGHT_UNIT_M,
    INPUT_PX,
    OFFSET,
    STRIDE,
    UPRIGHT,
)
from bracket_cell.learned.records import UNKNOWN
from bracket_ground.interfaces.pose import Array
from bracket_lab.learned.parts.data import Label, Scene

SCALES = (0.92, 1.08)  # by which training images differ
NEAREST = 1  # cells around a middle that learn to point at it
LEAST_SHOWN = 0.03  # share of its box; less of a thing is neither right nor wrong
SPREAD_OF_BOX, LEAST_SPREAD = 0.09, 0.9  # of the heat around a middle, in boxes and in cells


@dataclass(frozen=True, eq=False)
class Sample:
    """One training image.

    Attributes:
        image: (3, 240, 320).
        heat: (types + 1, rows, columns), 1 at middles, falling off around them.
        further: (FURTHER, rows, columns).
        weights: (FURTHER, rows, columns), 0 where nothing is to be learned.
    """

    image: NDArray[np.float32]
    heat: NDArray[np.float32]
    further: NDArray[np.float32]
    weights: NDArray[np.float32]


def sample(
    scene: Scene,
    types: tuple[str, ...],
    floor_m: float,
    rng: np.random.Generator | None,
    scales: tuple[float, float] = SCALES,
) -> Sample:
    """A training image; without a generator the image as it is, levelled.

    Args:
        floor_m: height of the tray's floor.
        scales: of a random turn, the least and the greatest.
    """
    turn, image = turned(scene, rng, scales)
    columns, rows = CELLS
    heat = np.zeros((len(types) + 1, rows, columns), np.float32)
    further, weights = np.zeros((2, FURTHER, rows, columns), np.float32)
    for label in scene.labels:
        _draw(label, turn, types, floor_m, heat, further, weights)
    planes = image.transpose(2, 0, 1).astype(np.float32) / 255 - 0.5
    return Sample(planes.astype(np.float32), heat, further, weights)


def turned(
    scene: Scene, rng: np.random.Generator | None, scales: tuple[float, float] = SCALES
) -> tuple[Array, NDArray[np.uint8]]:
    """(2, 3) from pixels of a scene to those of the network's input, and the input; turned at random by a generator."""
    height, width = scene.image.shape[:2]
    turn = np.array([[INPUT_PX[0] / width, 0.0, 0.0], [0.0, INPUT_PX[1] / height, 0.0]])
    turn[:, 2] = (np.diag(turn[:, :2]) - 1) / 2  # pixels count from their middles
    if rng is not None:
        turn = _random_turn(turn, rng, scales)
    seen = cv2.warpAffine(scene.image, turn, INPUT_PX, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    image = np.asarray(seen, np.uint8)
    return turn, levelled(image) if rng is None else spoiled(image, rng, camera=POOR)


def _random_turn(turn: Array, rng: np.random.Generator, scales: tuple[float, float]) -> Array:
    """About the image's middle: any angle, mirrored or not, a little larger or smaller, a little aside."""
    angle, scale = rng.uniform(-math.pi, math.pi), rng.uniform(*scales)
    mirror = 1 if rng.random() < 0.5 else -1
    cosine, sine = scale * math.cos(angle), scale * math.sin(angle)
    spin = np.array([[cosine * mirror, -sine], [sine * mirror, cosine]])
    middle = (np.array(INPUT_PX) - 1) / 2
    aside = middle + rng.uniform(-20, 20, 2) - spin @ middle
    return np.column_stack([spin @ turn[:, :2], spin @ turn[:, 2] + aside])


def _draw(
    label: Label,
    turn: Array,
    types: tuple[str, ...],
    floor_m: float,
    heat: NDArray[np.float32],
    further: NDArray[np.float32],
    weights: NDArray[np.float32],
) -> None:
    columns, rows = CELLS
    centre = turn[:, :2] @ label.centre_px + turn[:, 2]
    column, row = (int(value) for value in np.floor(centre / STRIDE))
    if label.shown < LEAST_SHOWN or not (0 <= column < columns and 0 <= row < rows):
        return
    outline = label.outline_px @ turn[:, :2].T + turn[:, 2]
    low, high = outline.min(axis=0), outline.max(axis=0)
    kind = len(types) if label.part == UNKNOWN else types.index(label.part)
    spread = max(LEAST_SPREAD, SPREAD_OF_BOX * float(np.sqrt(np.prod(high - low))) / STRIDE)
    across, down = np.arange(columns) - column, np.arange(rows)[:, np.newaxis] - row
    bump = np.exp(-(across**2 + down**2) / (2 * spread**2)).astype(np.float32)
    np.maximum(heat[kind], bump, out=heat[kind])
    axis = turn[:, :2] @ label.axis_px
    length = float(np.linalg.norm(axis)) / (10 * float(np.linalg.norm(turn[:, 0])))  # short where it points at us
    double = 2 * math.atan2(axis[1], axis[0])
    for at_row in range(max(0, row - NEAREST), min(rows, row + NEAREST + 1)):
        for at in range(max(0, column - NEAREST), min(columns, column + NEAREST + 1)):
            place = (slice(None), at_row, at)
            if weights[0, at_row, at] >= bump[at_row, at]:
                continue
            values, weight = further[place], weights[place]
            values[OFFSET] = centre / STRIDE - 0.5 - (at, at_row)
            values[BOX] = np.concatenate([centre - low, high - centre]) / BOX_UNIT_PX
            values[AXIS] = math.cos(double), math.sin(double)
            values[HEIGHT] = (label.pose.position_m[2] - floor_m) / HEIGHT_UNIT_M if label.pose is not None else 0.0
            values[UPRIGHT] = bool(label.upright)
            known = label.part != UNKNOWN
            weight[:] = bump[at_row, at]
            weight[AXIS] *= min(1.0, length) if known else 0.0
            weight[HEIGHT] *= known and label.pose is not None
            weight[UPRIGHT] *= known and label.upright is not None
