"""What the centre net says and how it is read: maps at a quarter of its input (Zhou, Objects as Points, 2019).

Channels: a heat map for each type and one for unknown things, offset (2), box (4), axis (2), height, upright.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from cell.interfaces.pose import Array

INPUT_PX = (320, 240)
STRIDE = 4
CELLS = (INPUT_PX[0] // STRIDE, INPUT_PX[1] // STRIDE)
OFFSET, BOX, AXIS, HEIGHT, UPRIGHT = slice(0, 2), slice(2, 6), slice(6, 8), 8, 9  # after the heat maps
FURTHER = 10
BOX_UNIT_PX, HEIGHT_UNIT_M = 32.0, 0.05
LEVELS = np.arange(256, dtype=np.float32) / np.float32(255) - np.float32(0.5)  # of a byte, for networks
PEAK = np.ones((3, 3), np.uint8)

Maps = NDArray[np.float32]


@dataclass(frozen=True)
class Peak:
    """One thing that the centre net sees, in pixels of its input.

    Attributes:
        kind: index of its type; the number of types for an unknown thing.
        centre_px: (2,) the middle of its body.
        box_px: (4,) left, top, right, bottom of all of it.
        axis_rad: direction of its x axis in the image, of a line and not of an arrow: within half a turn.
        height_m: of its frame above the tray's floor.
        upright: probability that it stands.
        cell: (column, row) of its peak.
    """

    kind: int
    score: float
    centre_px: Array
    box_px: Array
    axis_rad: float
    height_m: float
    upright: float
    cell: tuple[int, int]


def network_input(image: NDArray[np.uint8]) -> NDArray[np.float32]:
    """An image (height, width, 3) as the centre net takes it, (1, 3, 240, 320); sampled as images of its training."""
    small = cv2.resize(image, INPUT_PX, interpolation=cv2.INTER_LINEAR)
    planes = np.empty((1, 3, *reversed(INPUT_PX)), np.float32)
    for plane, channel in zip(planes[0], cv2.split(small), strict=True):
        cv2.LUT(channel, LEVELS, plane)
    return planes


def peaks(heat: Maps, further: Maps, least: float) -> list[Peak]:
    """What the maps of one image say, the surest first.

    Args:
        heat: (types + 1, rows, columns) probabilities.
        further: (FURTHER, rows, columns).
        least: score below which a peak is nothing.
    """
    found = []
    for kind, layer in enumerate(heat):
        highest = cv2.dilate(layer, PEAK)
        for row, column in np.argwhere((layer >= highest) & (layer > least)):
            found.append(_peak(kind, float(layer[row, column]), int(column), int(row), further[:, row, column]))
    return _apart(sorted(found, key=lambda peak: -peak.score))


def _peak(kind: int, score: float, column: int, row: int, values: NDArray[np.float32]) -> Peak:
    centre = (np.array([column, row]) + 0.5 + values[OFFSET]) * STRIDE
    left, top, right, bottom = values[BOX] * BOX_UNIT_PX
    box = np.array([centre[0] - left, centre[1] - top, centre[0] + right, centre[1] + bottom])
    axis = math.atan2(values[AXIS][1], values[AXIS][0]) / 2
    upright = 1.0 / (1.0 + math.exp(-float(values[UPRIGHT])))
    return Peak(kind, score, centre, box, axis, float(values[HEIGHT]) * HEIGHT_UNIT_M, upright, (column, row))


def _apart(found: Sequence[Peak], most: float = 0.5) -> list[Peak]:
    """Without what a surer one of its type already stands for; of what type a thing is may stay open."""
    kept: list[Peak] = []
    for peak in found:
        if all(peak.kind != other.kind or overlap(peak.box_px, other.box_px) < most for other in kept):
            kept.append(peak)
    return kept


def overlap(first: Array, second: Array) -> float:
    """Intersection over union of two boxes (left, top, right, bottom)."""
    left, top, right, bottom = first.tolist()
    a, b, c, d = second.tolist()
    both = max(min(right, c) - max(left, a), 0.0) * max(min(bottom, d) - max(top, b), 0.0)
    return float(both / max((right - left) * (bottom - top) + (c - a) * (d - b) - both, 1e-9))
