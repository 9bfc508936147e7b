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

from bracket_ground.interfaces.camera_model import CameraModel
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import PartType
from bracket_ground.interfaces.solid import Solid

INPUT_PX = (320, 240)
STRIDE = 4
CELLS = (INPUT_PX[0] // STRIDE, INPUT_PX[1] // STRIDE)
OFFSET, BOX, AXIS, HEIGHT, UPRIGHT = slice(0, 2), slice(2, 6), slice(6, 8), 8, 9  # after the heat maps
FURTHER = 10
BOX_UNIT_PX, HEIGHT_UNIT_M = 32.0, 0.05
LEVELS = np.arange(256, dtype=np.float32) / np.float32(255) - np.float32(0.5)  # of a byte, for networks
PEAK = np.ones((3, 3), np.uint8)
MOST_PEAKS = 100  # of an image, as in Zhou 2019; a hardly trained network has thousands, and each costs a closer look

Maps = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
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
    """What the maps of one image say, the surest first: MOST_PEAKS at most.

    Args:
        heat: (types + 1, rows, columns) probabilities.
        further: (FURTHER, rows, columns).
        least: score below which a peak is nothing.
    """
    highest = np.stack([cv2.dilate(layer, PEAK) for layer in heat])
    cells = np.argwhere((heat >= highest) & (heat > least))
    surest = cells[np.argsort(-heat[tuple(cells.T)], kind="stable")[:MOST_PEAKS]]
    found = [
        _peak(kind, float(heat[kind, row, col]), col, row, further[:, row, col]) for kind, row, col in surest.tolist()
    ]
    return _apart(found)


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


CROP_PX = (72, 48)  # along the part and across it
STEP_M = 0.0015  # a pixel of the crop on the bench
PLANES = 5  # red, green, blue, and the two of the direction that it is seen from


SIGNS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])

Crops = NDArray[np.float32]


def crop_of(
    image: NDArray[np.uint8], camera: CameraModel, world_from_camera: Pose, place_m: Array, yaw_rad: float
) -> Crops:
    """What is seen around a place, (PLANES, height, width).

    Args:
        place_m: (3,) the supposed middle of the part's body.
        yaw_rad: the supposed heading of its x axis.

    The two last planes are constant: by how much the camera is off the vertical above the place, along and across.
    """
    crop: Crops = crops_of(image, camera, world_from_camera, [place_m], [yaw_rad])[0]
    return crop


def crops_of(
    image: NDArray[np.uint8],
    camera: CameraModel,
    world_from_camera: Pose,
    places_m: Sequence[Array],
    yaws_rad: Sequence[float],
    size_px: tuple[int, int] = CROP_PX,
    step_m: float = STEP_M,
) -> Crops:
    """`crop_of` several places, (n, PLANES, height, width); a bent lens costs as much for one as for many."""
    around = SIGNS * (np.array(size_px) - 1) / 2
    turns = np.array([[[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]] for yaw in yaws_rad])
    corners = np.zeros((len(turns), len(around), 3))
    corners[..., :2] = around * step_m @ turns
    corners += np.array(places_m)[:, np.newaxis]
    seen = camera.project(world_from_camera, corners.reshape(-1, 3)).reshape(len(turns), -1, 2).astype(np.float32)
    width, height = size_px
    own = (around - around[0]).astype(np.float32)
    crops = np.empty((len(turns), PLANES, height, width), np.float32)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    for planes, outline, place_m, turn in zip(crops, seen, places_m, turns, strict=True):
        onto = cv2.getPerspectiveTransform(own, outline)
        crop = cv2.warpPerspective(image, onto, size_px, flags=flags, borderMode=cv2.BORDER_REPLICATE)
        planes[:3] = crop.transpose(2, 0, 1) / np.float32(255) - np.float32(0.5)
        way = np.array(world_from_camera.position_m) - place_m
        planes[3:] = (turn @ way[:2] / way[2])[:, np.newaxis, np.newaxis]
    return crops


def half_turned(crops: Crops) -> Crops:
    """What crops (n, PLANES, height, width) were if their parts headed the other way."""
    turned = crops[..., ::-1, ::-1].copy()
    turned[:, 3:] *= -1
    return turned


def surface_of(kind: PartType) -> Array:
    """Points (n, 3) that the outlines of a part's body and peg go through, in the part's frame."""
    diameter, length = kind.peg_diameter_m, kind.peg_length_m
    peg = Solid(solid="cylinder", size_m=(diameter, diameter, length), centre_m=(0.0, 0.0, -length / 2))
    points: Array = np.concatenate([solid.points() for solid in (*kind.solids, peg)])
    return points
