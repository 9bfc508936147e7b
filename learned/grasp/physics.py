"""Which neighbours are in the way of a grasp: the gripper's outline against their bodies, touching or not.

Labels are about the true outline and the true bodies; the rule asks the same of detected bodies, with margins.

The outline is a set of upright prisms in the frame of the jaw. Coming down, a prism sweeps everything above its lower
end; closing, a finger sweeps the gap beside the part. So a neighbour is touched where its footprint overlaps a
prism's swept footprint and its body reaches above the prism's lower end. A peg is thinner than the body above it,
and whatever sweeps over it meets that body first. The pads are wider than the finger links above them, so the links
sweep nothing of their own; what is above the palm is higher than any two parts differ.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cell.interfaces.pose import Array
from learned.grasp.boxes import Blocks, Boxes, rectangle_gaps_m
from learned.grasp.candidates import available, gripped_m, jaw_centre_m, jaw_yaw_rad, mark_missing
from learned.grasp.settings import GripperOutline


@dataclass(frozen=True)
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
