"""Numbers that describe one part beside another, for a network that asks whether the second is in the way.

The gripper, its fingers opened, comes down at the first part by one candidate; the second part is described in the
frame of the jaw. Distances come twice: with sizes and heights that the product gives to the type, and with those
that were detected, because a detector may measure badly what a catalogue knows. Each also comes as a multiple of its
own standard deviation, for the noise that the detections have.

Planning happens within a tick, so all that can be is computed for all pairs in one array operation.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bracket_cell.learned.grasp.boxes import Blocks, Boxes
from bracket_cell.learned.grasp.candidates import PLACE_M, SIDE
from bracket_cell.learned.grasp.settings import DetectionNoise, GripperOutline
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.product import Product

Indices = NDArray[np.intp]

PAIR_FEATURES = 22
REACH_M = 0.16  # no outline of gripper or part extends so far from a part's middle that farther pairs matter
_UNIT_M = 0.01
_MOST_UNITS = 6.0  # farther is as good as far
_LEAST_SPREAD_M = 1e-4
_NOISE_M, _NOISE_RAD = 0.005, 0.175
_OUTLINE = GripperOutline()


@dataclass(frozen=True)
class Pairs:
    """Indices (p,) each: a part, a candidate to grasp it, a neighbour within reach."""

    part: Indices
    candidate: Indices
    neighbour: Indices

    def __len__(self) -> int:
        return len(self.part)


def near_pairs(boxes: Boxes, exists: Blocks) -> Pairs:
    """All pairs of neighbours, for every candidate that the part has.

    Args:
        exists: (n, candidates).
    """
    x, y = boxes.centre_m[:, 0], boxes.centre_m[:, 1]
    near = np.hypot(x - x[:, None], y - y[:, None]) < REACH_M
    near[np.diag_indices(len(boxes))] = False
    return Pairs(*np.nonzero(near[:, None] & exists[..., None]))


def as_in_catalogue(boxes: Boxes, product: Product) -> Boxes:
    """The boxes with the sizes that the product gives to their types, standing on their pegs on a floor at height 0."""
    parts = [product.parts[name] for name in boxes.types]
    size = np.array([part.size_m for part in parts])
    return replace(boxes, size_m=size, bottom_m=np.array([part.peg_length_m for part in parts]))


def pair_features(boxes: Boxes, pairs: Pairs, product: Product, noise: DetectionNoise) -> NDArray[np.float32]:
    """Features (p, PAIR_FEATURES) of neighbours in the jaw's frame at the parts.

    A box looks the same from both ends and from both sides, and so does the gripper: the neighbour is mirrored into
    the quarter x, y >= 0 of the jaw's frame, so that the network need not learn these symmetries.

    Args:
        boxes: as detected.
        noise: that the detections have, as far as it is known.
    """
    part, neighbour, side = pairs.part, pairs.neighbour, SIDE[pairs.candidate]
    known = as_in_catalogue(boxes, product)
    size = np.array([known.size_m, boxes.size_m])  # (variants, n, 3)
    bottom = np.array([known.bottom_m, boxes.bottom_m])
    yaw = boxes.yaw_rad[part] + side * (np.pi / 2)
    x, y = (boxes.centre_m[neighbour] - boxes.centre_m[part]).T
    cos, sin, turn = np.cos(yaw), np.sin(yaw), boxes.yaw_rad[neighbour] - yaw
    beside, across = x * cos + y * sin, y * cos - x * sin  # along the fingers' width from the part, then from the jaw
    along = beside - PLACE_M[pairs.candidate]
    # along the fingers' width; between the fingers
    own = np.array([size[:, part, side], size[:, part, 1 - side]])
    half = np.array([size[:, neighbour, 0], size[:, neighbour, 1]]) / 2
    near, far, body = _gaps_m(along, beside, np.abs(across), turn * np.where(across < 0, -1.0, 1.0), own, half)
    above = _above_m(size[..., 2], bottom, pairs)
    spread = np.hypot(1.4 * noise.position_m, noise.yaw_rad / 1.4 * np.hypot(along, across))
    rise = 1.4 * np.hypot(noise.bottom_m, noise.size_m)

    found = np.empty((PAIR_FEATURES, len(pairs)))
    found[0:2], found[2:4], found[4], found[5:7] = near, far, body[0], above
    found[7], found[8], found[9:11] = np.abs(along), np.abs(across), half[:, 0]
    found[:11] /= _UNIT_M
    found[11:14] = found[[0, 2, 4]] * (_UNIT_M / np.maximum(spread, _LEAST_SPREAD_M))
    found[14] = above[1] / max(rise, _LEAST_SPREAD_M)
    np.minimum(np.maximum(found[:15], -_MOST_UNITS, out=found[:15]), _MOST_UNITS, out=found[:15])
    found[15], found[16] = np.cos(2 * turn), np.where(along * across < 0, -1.0, 1.0) * np.sin(2 * turn)
    found[17] = own[1, 0] / _UNIT_M
    found[18:20] = [[noise.position_m / _NOISE_M], [noise.yaw_rad / _NOISE_RAD]]
    found[20:22] = [[noise.bottom_m / _NOISE_M], [noise.size_m / _NOISE_M]]
    features: NDArray[np.float32] = found.T.astype(np.float32)
    return features


def _gaps_m(along: Array, beside: Array, across: Array, turn: Array, own: Array, half: Array) -> Array:
    """(3, variants, p) gaps between the neighbour and the nearer finger's sweep, the farther one's, and the part.

    All are rectangles on the jaw's axes; a gap is the widest along any of the rectangles' side directions.

    Args:
        along, across, turn: (p,) the neighbour in the jaw's frame, mirrored so that it is at `across` >= 0.
        beside: (p,) as `along`, from the part's middle.
        own: (2, variants, p) extent of the part along the fingers' width, and between the fingers.
        half: (2, variants, p) half sides of the neighbour.
    """
    thickness, width, _ = _OUTLINE.pad_size_m
    swept = _OUTLINE.clearance_m + thickness
    first, second = np.empty((2, 3, *own.shape[1:]))  # half sides of the three rectangles
    first[:2], first[2] = width / 2, own[0] / 2
    second[:2], second[2] = swept / 2, own[1] / 2
    middle = np.zeros_like(first)
    middle[0] = (own[1] + swept) / 2
    middle[1] = -middle[0]
    x, y = np.array([along, along, beside])[:, None], across - middle
    cos, sin = np.cos(turn), np.sin(turn)
    more, less = np.abs(cos), np.abs(sin)
    gap: Array = np.abs(x) - (first + half[0] * more + half[1] * less)
    np.maximum(gap, np.abs(y) - (second + half[0] * less + half[1] * more), out=gap)
    np.maximum(gap, np.abs(x * cos + y * sin) - (half[0] + first * more + second * less), out=gap)
    np.maximum(gap, np.abs(y * cos - x * sin) - (half[1] + first * less + second * more), out=gap)
    near, far = np.minimum(gap[0], gap[1]), np.maximum(gap[0], gap[1])
    gap[0], gap[1] = near, far
    return gap


def _above_m(height: Array, bottom: Array, pairs: Pairs) -> Array:
    """(variants, p) how far the neighbour reaches above the fingertips at the part, of heights (variants, n)."""
    top = bottom + height
    tip = np.maximum(bottom + _OUTLINE.bottom_gap_m, top - _OUTLINE.grasp_depth_m)
    above: Array = top[:, pairs.neighbour] - tip[:, pairs.part]
    return above
