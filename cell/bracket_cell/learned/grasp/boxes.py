"""Upright boxes on the tray, and where two of them overlap."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bracket_ground.errors import ModelError
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.product import Product

Blocks = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Boxes:
    """Bodies of n upright parts.

    Attributes:
        types: type name of each.
        centre_m: (n, 2) middle of the body on the tray.
        yaw_rad: (n,) heading of the longer side.
        bottom_m: (n,) height of the body's bottom.
        size_m: (n, 3) length, width, height.
    """

    types: tuple[str, ...]
    centre_m: Array
    yaw_rad: Array
    bottom_m: Array
    size_m: Array

    def __len__(self) -> int:
        return len(self.types)

    @property
    def top_m(self) -> Array:
        """(n,) height of the bodies' upper sides."""
        top: Array = self.bottom_m + self.size_m[:, 2]
        return top

    def take(self, indices: Sequence[int]) -> Boxes:
        """The boxes at `indices`, in that order."""
        chosen = list(indices)
        return Boxes(
            tuple(self.types[i] for i in chosen),
            self.centre_m[chosen],
            self.yaw_rad[chosen],
            self.bottom_m[chosen],
            self.size_m[chosen],
        )


def boxes_of(parts: Sequence[PartDetection], product: Product) -> Boxes:
    """The boxes that a detector saw.

    Raises:
        ModelError: something stands that is of no type of the product.
    """
    if unknown := sorted({part.part for part in parts if part.upright} - set(product.parts)):
        raise ModelError(f"detections of unknown part types {unknown}; the product has {list(product.parts)}")
    position = np.array([part.world_from_part.position_m for part in parts])
    return Boxes(
        tuple(part.part for part in parts),
        position[:, :2],
        np.array([part.world_from_part.yaw_rad for part in parts]),
        position[:, 2],
        np.array([part.size_m for part in parts]),
    )


def bodies_overlap(first: Boxes, second: Boxes, gap_m: float) -> Blocks:
    """(n, m): whether the footprints come nearer to each other than a gap (measured along the boxes' sides)."""
    return rectangles_overlap(
        first.centre_m[:, None],
        first.yaw_rad[:, None],
        first.size_m[:, None, :2] / 2 + gap_m,
        second.centre_m[None],
        second.yaw_rad[None],
        second.size_m[None, :, :2] / 2,
    )


def rectangles_overlap(
    centre_a: Array, yaw_a: Array, half_a: Array, centre_b: Array, yaw_b: Array, half_b: Array
) -> Blocks:
    """Separating-axis test of rectangles with half sides (..., 2); all arguments broadcast."""
    overlap: Blocks = rectangle_gaps_m(centre_a, yaw_a, half_a, centre_b, yaw_b, half_b) < 0.0
    return overlap


def rectangle_gaps_m(
    centre_a: Array, yaw_a: Array, half_a: Array, centre_b: Array, yaw_b: Array, half_b: Array
) -> Array:
    """Widest gap between rectangles along any of their side directions; negative where they overlap."""
    x, y = centre_b[..., 0] - centre_a[..., 0], centre_b[..., 1] - centre_a[..., 1]
    turn = yaw_b - yaw_a
    turn_cos, turn_sin = np.abs(np.cos(turn)), np.abs(np.sin(turn))
    gaps = []
    for yaw, own, other in ((yaw_a, half_a, half_b), (yaw_b, half_b, half_a)):
        cos, sin = np.cos(yaw), np.sin(yaw)
        along = own[..., 0] + other[..., 0] * turn_cos + other[..., 1] * turn_sin
        across = own[..., 1] + other[..., 0] * turn_sin + other[..., 1] * turn_cos
        gaps += [np.abs(x * cos + y * sin) - along, np.abs(y * cos - x * sin) - across]
    widest: Array = np.maximum(np.maximum(gaps[0], gaps[1]), np.maximum(gaps[2], gaps[3]))
    return widest


def sliding_distance_m(first: Boxes, second: Boxes, direction: Array, gap_m: Array) -> Array:
    """How far apart (n,) in directions (n, 2) two boxes' centres must be for their bodies to have exactly gaps (n,)."""
    half_first, half_second = first.size_m[:, :2] / 2 + gap_m[:, None], second.size_m[:, :2] / 2
    turn = second.yaw_rad - first.yaw_rad
    cos, sin = np.abs(np.cos(turn)), np.abs(np.sin(turn))
    turned = np.stack([np.stack([cos, sin], axis=1), np.stack([sin, cos], axis=1)], axis=1)
    distances = []
    for yaw, own, other in ((first.yaw_rad, half_first, half_second), (second.yaw_rad, half_second, half_first)):
        axes = np.stack([np.stack([np.cos(yaw), np.sin(yaw)], 1), np.stack([-np.sin(yaw), np.cos(yaw)], 1)], axis=1)
        along = np.abs(np.einsum("nij,nj->ni", axes, direction))
        reach = own + np.einsum("nij,nj->ni", turned, other)
        distances.append((reach / np.maximum(along, 1e-9)).min(axis=1))
    least: Array = np.minimum(*distances)
    return least
