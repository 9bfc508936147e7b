"""Upright boxes on the tray and what keeps the gripper from one of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cell.interfaces.errors import ModelError
from cell.interfaces.perception import PartDetection
from cell.interfaces.pose import Array
from cell.interfaces.product import Product
from learned.grasp.settings import GripperGeometry

Blocks = NDArray[np.bool_]


@dataclass(frozen=True)
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
        ModelError: a detection names a type that the product does not have.
    """
    if unknown := sorted({part.part for part in parts} - set(product.parts)):
        raise ModelError(f"detections of unknown part types {unknown}; the product has {list(product.parts)}")
    return Boxes(
        tuple(part.part for part in parts),
        np.array([part.world_from_part.position_m[:2] for part in parts]),
        np.array([part.world_from_part.yaw_rad for part in parts]),
        np.array([part.world_from_part.position_m[2] for part in parts]),
        np.array([part.size_m for part in parts]),
    )


def fingertip_height_m(boxes: Boxes, gripper: GripperGeometry) -> Array:
    """Height (n,) of the fingertips when each box is grasped."""
    height: Array = np.maximum(boxes.bottom_m + gripper.bottom_gap_m, boxes.top_m - gripper.grasp_depth_m)
    return height


def blocking(boxes: Boxes, gripper: GripperGeometry) -> Blocks:
    """Blocks (n, n): [i, j] is true where the body of j is in the way of grasping i.

    In the way is a body that reaches up to the fingertips and lies under a finger or between a finger and the part
    (where the finger closes), or one that reaches up to the hand and lies under it.
    """
    tip = fingertip_height_m(boxes, gripper)
    meets_finger = _under_fingers(boxes, gripper) & (boxes.top_m[None] > tip[:, None] - gripper.below_gap_m)
    hand = tip + gripper.finger_length_m
    meets_hand = _under_hand(boxes, gripper) & (boxes.top_m[None] > hand[:, None] - gripper.below_gap_m)
    blocks: Blocks = (meets_finger | meets_hand) & ~np.eye(len(boxes), dtype=bool)
    return blocks


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
    between = centre_b - centre_a
    overlap: Blocks = np.ones(np.broadcast_shapes(yaw_a.shape, yaw_b.shape), dtype=bool)
    turn = np.abs(np.cos(yaw_b - yaw_a)), np.abs(np.sin(yaw_b - yaw_a))
    for yaw, own, other in ((yaw_a, half_a, half_b), (yaw_b, half_b, half_a)):
        cos, sin = np.cos(yaw), np.sin(yaw)
        along = np.abs(between[..., 0] * cos + between[..., 1] * sin)
        across = np.abs(between[..., 1] * cos - between[..., 0] * sin)
        overlap &= along < own[..., 0] + other[..., 0] * turn[0] + other[..., 1] * turn[1]
        overlap &= across < own[..., 1] + other[..., 0] * turn[1] + other[..., 1] * turn[0]
    return overlap


def sliding_distance_m(first: Boxes, second: Boxes, direction: Array, gap_m: float) -> float:
    """How far apart in a direction (2,) two boxes' centres must be for their bodies to have exactly this gap."""
    half_first, half_second = first.size_m[0, :2] / 2 + gap_m, second.size_m[0, :2] / 2
    turn = float(second.yaw_rad[0] - first.yaw_rad[0])
    cos, sin = abs(np.cos(turn)), abs(np.sin(turn))
    turned = np.array([[cos, sin], [sin, cos]])
    distances = []
    for yaw, reach in (
        (first.yaw_rad[0], half_first + turned @ half_second),
        (second.yaw_rad[0], half_second + turned @ half_first),
    ):
        axes = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
        distances.extend(reach / np.maximum(np.abs(axes @ direction), 1e-9))
    return float(min(distances))


def _under_fingers(boxes: Boxes, gripper: GripperGeometry) -> Blocks:
    """(n, n): body j reaches into the strip, margin included, that the fingers sweep beside box i as they close."""
    strip = gripper.clearance_m + gripper.finger_thickness_m + gripper.margin_m
    across = np.stack([-np.sin(boxes.yaw_rad), np.cos(boxes.yaw_rad)], axis=1)
    offset = across * (boxes.size_m[:, 1] + strip)[:, None] / 2
    half = np.array([gripper.finger_width_m + 2 * gripper.margin_m, strip]) / 2
    under: Blocks = np.zeros((len(boxes), len(boxes)), dtype=bool)
    for side in (-1, 1):
        under |= rectangles_overlap(
            (boxes.centre_m + side * offset)[:, None],
            boxes.yaw_rad[:, None],
            half,
            boxes.centre_m[None],
            boxes.yaw_rad[None],
            boxes.size_m[None, :, :2] / 2,
        )
    return under


def _under_hand(boxes: Boxes, gripper: GripperGeometry) -> Blocks:
    """(n, n): body j reaches under the hand that grasps box i."""
    return rectangles_overlap(
        boxes.centre_m[:, None],
        boxes.yaw_rad[:, None],
        np.array(gripper.hand_size_m[::-1]) / 2,
        boxes.centre_m[None],
        boxes.yaw_rad[None],
        boxes.size_m[None, :, :2] / 2,
    )
