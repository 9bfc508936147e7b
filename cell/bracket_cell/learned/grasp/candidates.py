"""Grasp candidates, and which neighbours are in the way of each: the gripper's outline against their bodies.

A part is grasped across its width, or across its length where the jaw opens so far; in its middle or beside it. Where
beside the middle is said in ground/bracket_ground/interfaces/grasping.py, to these and to the skills alike.

Labels are about the true outline and the true bodies; the rule asks the same of detected bodies, with margins. The
outline is a set of upright prisms in the frame of the jaw. Coming down, a prism sweeps everything above its lower end;
closing, a finger sweeps the gap beside the part. So a neighbour is touched where its footprint overlaps a prism's swept
footprint and its body reaches above the prism's lower end. A peg is thinner than the body above it, and whatever sweeps
over it meets that body first. The pads are wider than the finger links above them, so the links sweep nothing of their
own; what is above the palm is higher than any two parts differ.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol, get_args

import numpy as np

from bracket_cell.learned.grasp.boxes import Blocks, Boxes, rectangle_gaps_m
from bracket_cell.learned.grasp.settings import GripperOutline
from bracket_ground.interfaces.grasping import OFF_MIDDLE_M, PAD_WIDTH_M, held_off_middle
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.product import PartType, Product

Candidate = Literal["width", "length", "width+", "length+", "width-", "length-", "length+half", "length-half"]
CANDIDATES: tuple[Candidate, ...] = get_args(Candidate)
SIDE = np.array([0, 1, 0, 1, 0, 1, 1, 1])  # 0: the fingers close across the width, 1: across the length
_WIDTH_M, _LENGTH_M = OFF_MIDDLE_M[1], OFF_MIDDLE_M[0]
PLACE_M = np.array([0, 0, _WIDTH_M, _LENGTH_M, -_WIDTH_M, -_LENGTH_M, _LENGTH_M / 2, -_LENGTH_M / 2])
"""Of the pads' middle, along the sides that they close on: those of `places_m`."""
_TURNED = [0, 1, 4, 5, 2, 3, 7, 6]  # what each candidate is called from the part's other end
_TURN_RAD = SIDE * np.pi / 2


class Opening(Protocol):
    """What decides which candidates exist."""

    @property
    def clearance_m(self) -> float:
        """Gap between each finger and the body during descent."""
        ...

    @property
    def one_way(self) -> bool:
        """Parts are grasped across their width and in the middle alone."""
        ...

    @property
    def middle_alone(self) -> tuple[str, ...]:
        """Types of parts that are grasped in the middle alone."""
        ...

    @property
    def pad_size_m(self) -> tuple[float, float, float]:
        """Thickness, width and length of a pad."""
        ...

    @property
    def stroke_m(self) -> float:
        """Widest opening of the jaw."""
        ...

    @property
    def grasp_depth_m(self) -> float:
        """Fingertips reach this far below the body's top ..."""
        ...

    @property
    def bottom_gap_m(self) -> float:
        """... but stay this far above its bottom."""
        ...


def gripped_m(boxes: Boxes) -> Array:
    """Extent (n, candidates) of each body between the fingers."""
    extent: Array = boxes.size_m[:, 1 - SIDE]
    return extent


def jaw_yaw_rad(boxes: Boxes) -> Array:
    """Heading (n, candidates) of the fingers' width; they close at a right angle to it."""
    yaw: Array = boxes.yaw_rad[:, None] + _TURN_RAD
    return yaw


def jaw_centre_m(boxes: Boxes) -> Array:
    """Middle (n, candidates, 2) of the jaw over each body."""
    yaw = jaw_yaw_rad(boxes)
    along = np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)
    centre: Array = boxes.centre_m[:, None] + along * PLACE_M[:, None]
    return centre


def available(boxes: Boxes, opening: Opening) -> Blocks:
    """(n, candidates): whether the jaw opens wide enough and may grasp so."""
    fits: Blocks = gripped_m(boxes) + 2 * opening.clearance_m <= opening.stroke_m
    if opening.one_way:
        fits[:, 1:] = False
    if opening.middle_alone:
        fits[np.ix_(np.isin(boxes.types, opening.middle_alone), PLACE_M != 0.0)] = False
    return fits


def middle_alone(product: Product, opening: Opening) -> tuple[str, ...]:
    """Types of a product whose shape lets them be grasped in the middle alone."""
    narrow = opening.pad_size_m[1] < PAD_WIDTH_M
    return tuple(name for name, kind in product.parts.items() if narrow or not _held_off_middle(kind, opening))


def _held_off_middle(kind: PartType, opening: Opening) -> bool:
    tips_m = max(opening.bottom_gap_m, kind.size_m[2] - opening.grasp_depth_m)
    fits = [axis for axis in (0, 1) if kind.size_m[axis] + 2 * opening.clearance_m <= opening.stroke_m]
    return all(held_off_middle(kind, axis, tips_m) for axis in fits)


def mark_missing(blocks: Blocks, exists: Blocks) -> Blocks:
    """Blocks (n, candidates, n) in which a candidate that does not exist is blocked by the part itself alone.

    Args:
        blocks: [i, c, j] true where j is in the way of grasping i by candidate c.
        exists: (n, candidates).
    """
    own = np.eye(len(blocks), dtype=bool)[:, None]
    marked: Blocks = np.where(exists[..., None], blocks & ~own, own)
    return marked


def fixed(blocks: Blocks, parts: Sequence[PartDetection]) -> Blocks:
    """The blocks where what does not stand is in the way of others and cannot be grasped itself."""
    standing = np.array([part.upright for part in parts])
    return mark_missing(blocks, ~blocks[np.arange(len(blocks)), :, np.arange(len(blocks))] & standing[:, None])


def as_headed(blocks: Blocks, boxes: Boxes, seen: Boxes) -> Blocks:
    """Blocks of boxes by the candidates of the boxes as seen: a box looks the same from its other end."""
    turned = np.cos(seen.yaw_rad - boxes.yaw_rad) < 0.0
    headed: Blocks = np.where(turned[:, None, None], blocks[:, _TURNED], blocks)
    return headed


def graspable(blocks: Blocks) -> Blocks:
    """(n,): whether any candidate of a part is free."""
    free: Blocks = np.any(~blocks.any(axis=-1), axis=-1)
    return free


@dataclass(frozen=True, eq=False)
class _Prism:
    """Swept footprint of one prism for each way to grasp each box, in the jaw's frame.

    Attributes:
        offset_m: (n, candidates) of its middle, in the direction in which the fingers close.
        half_m: (n, candidates, 2) half sides, along the fingers' width and in the closing direction.
        above_tip_m: height of its lower end above the fingertips.
    """

    offset_m: Array
    half_m: Array
    above_tip_m: float


def touching(boxes: Boxes, outline: GripperOutline) -> Blocks:
    """Blocks (n, candidates, n): [i, c, j] is true where grasping i by candidate c would touch j.

    A candidate that does not exist is blocked by the part itself.
    """
    gap = clearance_m(boxes, outline)
    return mark_missing(gap < 0.0, available(boxes, outline))


def clearance_m(boxes: Boxes, outline: GripperOutline) -> Array:
    """(n, candidates, n): by how much grasping i by candidate c misses j, beside or above it; negative if it touches.

    The whole outline misses j by the least of what its prisms miss.
    """
    tip = fingertips_m(boxes, outline) - outline.below_gap_m
    top = boxes.top_m - outline.fitting_m
    least: Array = np.full((len(boxes), gripped_m(boxes).shape[1], len(boxes)), np.inf)
    for prism in _prisms(boxes, outline):
        above = (tip[:, None] + prism.above_tip_m - top)[:, None]
        least = np.minimum(least, np.maximum(_beside(boxes, prism), above))
    return least


def fingertips_m(boxes: Boxes, outline: GripperOutline) -> Array:
    """Height (n,) of the fingertips when each box is grasped."""
    height: Array = np.maximum(boxes.bottom_m + outline.bottom_gap_m, boxes.top_m - outline.grasp_depth_m)
    return height


def _prisms(boxes: Boxes, outline: GripperOutline) -> tuple[_Prism, ...]:
    extent = gripped_m(boxes)
    thickness, width, _ = outline.pad_size_m
    swept = outline.clearance_m + thickness + outline.margin_m
    offset, flat = (extent + swept) / 2, np.ones_like(extent)[..., None]
    finger = flat * np.array([width + 2 * outline.margin_m, swept]) / 2
    palm = flat * np.array([outline.palm_size_m[1], outline.palm_size_m[0]]) / 2
    return (
        _Prism(offset, finger, 0.0),
        _Prism(-offset, finger, 0.0),
        _Prism(np.zeros_like(extent), palm, outline.palm_above_tip_m),
    )


def _beside(boxes: Boxes, prism: _Prism) -> Array:
    """(n, candidates, n): gap between the prism's footprint and each body's."""
    yaw = jaw_yaw_rad(boxes)
    across = np.stack([-np.sin(yaw), np.cos(yaw)], axis=-1)
    centre = jaw_centre_m(boxes) + across * prism.offset_m[..., None]
    return rectangle_gaps_m(
        centre[:, :, None],
        yaw[..., None],
        prism.half_m[:, :, None],
        boxes.centre_m,
        boxes.yaw_rad,
        boxes.size_m[:, :2] / 2,
    )
