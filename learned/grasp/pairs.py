"""Numbers that describe one part beside another, for a network that asks whether the second is in the way.

The gripper, its fingers opened, comes down at the first part by one option; the second part is described in the
frame of the jaw. Distances come twice: with sizes and heights as detected, and with those that the product gives to
the type, because a detector may measure badly what a catalogue knows. Each also comes as a multiple of its own
standard deviation, for the noise that the detections have.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cell.interfaces.pose import Array
from cell.interfaces.product import Product
from learned.grasp.boxes import Boxes, rectangle_gaps_m
from learned.grasp.options import available, gripped_m, jaw_yaw_rad
from learned.grasp.settings import DetectionNoise, GripperOutline

Indices = NDArray[np.intp]

PAIR_FEATURES = 22
REACH_M = 0.16  # no outline of gripper or part extends so far from a part's middle that farther pairs matter
_UNIT_M = 0.01
_MOST_UNITS = 6.0  # farther is as good as far
_LEAST_SPREAD_M = 1e-4
_NOISE_M, _NOISE_RAD = 0.005, 0.175
_SIDES = np.array([1.0, -1.0])[:, None, None]  # (fingers, variants, pairs)


@dataclass(frozen=True)
class Pairs:
    """Indices (p,) each: a part, an option to grasp it, a neighbour within reach."""

    part: Indices
    option: Indices
    neighbour: Indices

    def __len__(self) -> int:
        return len(self.part)


def near_pairs(boxes: Boxes) -> Pairs:
    """All pairs of neighbours, for every option that the part has."""
    offset = boxes.centre_m[None] - boxes.centre_m[:, None]
    near = np.hypot(offset[..., 0], offset[..., 1]) < REACH_M
    np.fill_diagonal(near, False)
    exists = available(boxes, GripperOutline())
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
    part, neighbour = pairs.part, pairs.neighbour
    variants = (as_in_catalogue(boxes, product), boxes)
    offset = boxes.centre_m[neighbour] - boxes.centre_m[part]
    yaw, other_yaw = jaw_yaw_rad(boxes)[part, pairs.option], boxes.yaw_rad[neighbour]
    cos, sin, turn = np.cos(yaw), np.sin(yaw), other_yaw - yaw
    along, across = offset[:, 0] * cos + offset[:, 1] * sin, offset[:, 1] * cos - offset[:, 0] * sin
    mirrored = np.where(along * across < 0, -1.0, 1.0)
    own = np.stack([gripped_m(variant)[part] for variant in variants])  # (2, p, options)
    gripped = np.take_along_axis(own, pairs.option[None, :, None], axis=2)[..., 0]
    half = np.stack([variant.size_m[neighbour, :2] for variant in variants]) / 2
    gaps = _finger_gaps_m(np.stack([along, across]), turn, gripped, half)
    bodies = _body_gap_m(variants[0], pairs)
    heights = np.stack([_above_m(variant, pairs) for variant in variants])
    distance = np.hypot(along, across)
    spread = np.hypot(1.4 * noise.position_m, noise.yaw_rad * distance / 1.4)
    rise = np.hypot(1.4 * noise.bottom_m, 1.4 * noise.size_m)
    lengths = np.concatenate([gaps.reshape(4, -1), bodies[None], heights, [np.abs(along), np.abs(across)], half[0].T])
    sure = np.stack([gaps[0, 0], gaps[1, 0], bodies]) / np.maximum(spread, _LEAST_SPREAD_M)
    sure_height = heights[1:] / max(rise, _LEAST_SPREAD_M)
    level = [
        noise.position_m / _NOISE_M,
        noise.yaw_rad / _NOISE_RAD,
        noise.bottom_m / _NOISE_M,
        noise.size_m / _NOISE_M,
    ]
    features: NDArray[np.float32] = np.concatenate(
        [
            np.clip(lengths / _UNIT_M, -_MOST_UNITS, _MOST_UNITS),
            np.clip(np.concatenate([sure, sure_height]), -_MOST_UNITS, _MOST_UNITS),
            [np.cos(2 * turn), mirrored * np.sin(2 * turn), gripped[0] / _UNIT_M],
            np.tile(np.array(level)[:, None], len(pairs)),
        ]
    ).T.astype(np.float32)
    return features


def _finger_gaps_m(offset: Array, turn: Array, gripped: Array, half: Array) -> Array:
    """(fingers, variants, p) gaps between the neighbour and what a finger sweeps; the nearer finger first.

    Args:
        offset: (2, p) of the neighbour's middle in the jaw's frame.
        turn: (p,) its heading there.
        gripped: (variants, p) extent of the part between the fingers.
        half: (variants, p, 2) half sides of the neighbour.
    """
    outline = GripperOutline()
    swept = outline.clearance_m + outline.pad_size_m[0]
    across = _SIDES * (gripped + swept)[None] / 2
    centre = np.stack([np.zeros_like(across), across], axis=-1)
    finger = np.array([outline.pad_size_m[1], swept]) / 2
    gaps = rectangle_gaps_m(centre, np.zeros(()), finger, offset.T, turn, half[None])
    ordered: Array = np.sort(gaps, axis=0)
    return ordered


def _body_gap_m(boxes: Boxes, pairs: Pairs) -> Array:
    """(p,) gap between both bodies."""
    part, neighbour = pairs.part, pairs.neighbour
    return rectangle_gaps_m(
        boxes.centre_m[part],
        boxes.yaw_rad[part],
        boxes.size_m[part, :2] / 2,
        boxes.centre_m[neighbour],
        boxes.yaw_rad[neighbour],
        boxes.size_m[neighbour, :2] / 2,
    )


def _above_m(boxes: Boxes, pairs: Pairs) -> Array:
    """(p,) how far the neighbour reaches above the fingertips at the part."""
    outline = GripperOutline()
    tip = np.maximum(boxes.bottom_m + outline.bottom_gap_m, boxes.top_m - outline.grasp_depth_m)
    above: Array = boxes.top_m[pairs.neighbour] - tip[pairs.part]
    return above
