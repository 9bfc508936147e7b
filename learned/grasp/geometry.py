"""The analytic rule: what keeps the gripper, with the skills' safety margins, from each way to grasp a box."""

from __future__ import annotations

import numpy as np

from cell.interfaces.pose import Array
from learned.grasp.boxes import Blocks, Boxes, rectangles_overlap
from learned.grasp.options import available, gripped_m, jaw_yaw_rad, mark_missing
from learned.grasp.settings import GripperGeometry

_SIDES = np.array([-1.0, 1.0])


def fingertip_height_m(boxes: Boxes, gripper: GripperGeometry) -> Array:
    """Height (n,) of the fingertips when each box is grasped."""
    height: Array = np.maximum(boxes.bottom_m + gripper.bottom_gap_m, boxes.top_m - gripper.grasp_depth_m)
    return height


def blocking(boxes: Boxes, gripper: GripperGeometry) -> Blocks:
    """Blocks (n, options, n): [i, o, j] is true where the body of j is in the way of grasping i by option o.

    In the way is a body that reaches up to the fingertips and lies under a finger or between a finger and the part
    (where the finger closes), or one that reaches up to the hand and lies under it. An option that does not exist is
    blocked by the part itself.
    """
    tip = fingertip_height_m(boxes, gripper) - gripper.below_gap_m
    reaches_fingers = boxes.top_m[None] > tip[:, None]
    reaches_hand = boxes.top_m[None] > tip[:, None] + gripper.finger_length_m
    blocks = _under_fingers(boxes, gripper) & reaches_fingers[:, None]
    if reaches_hand.any():
        blocks |= _under_hand(boxes, gripper) & reaches_hand[:, None]
    return mark_missing(blocks, available(boxes, gripper))


def _under_fingers(boxes: Boxes, gripper: GripperGeometry) -> Blocks:
    """(n, options, n): body j reaches into the strip, margin included, that the fingers sweep as they close."""
    strip = gripper.clearance_m + gripper.finger_thickness_m + gripper.margin_m
    yaw = jaw_yaw_rad(boxes)
    across = np.stack([-np.sin(yaw), np.cos(yaw)], axis=-1)
    offset = across * (gripped_m(boxes) + strip)[..., None] / 2
    centre = boxes.centre_m[:, None, None] + _SIDES[:, None] * offset[:, :, None]
    half = np.array([gripper.finger_width_m + 2 * gripper.margin_m, strip]) / 2
    under = rectangles_overlap(
        centre[:, :, :, None],
        yaw[:, :, None, None],
        half,
        boxes.centre_m,
        boxes.yaw_rad,
        boxes.size_m[:, :2] / 2,
    )
    either: Blocks = np.any(under, axis=2)
    return either


def _under_hand(boxes: Boxes, gripper: GripperGeometry) -> Blocks:
    """(n, options, n): body j reaches under the hand that grasps box i."""
    return rectangles_overlap(
        boxes.centre_m[:, None, None],
        jaw_yaw_rad(boxes)[..., None],
        np.array(gripper.hand_size_m[::-1]) / 2,
        boxes.centre_m,
        boxes.yaw_rad,
        boxes.size_m[:, :2] / 2,
    )
