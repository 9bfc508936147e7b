"""Labels agree with a brute-force check that samples points of the fingers and of the hand."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from cell.interfaces.errors import ModelError
from cell.interfaces.pose import Array
from learned.grasp.geometry import Boxes, blocking, boxes_of, fingertip_height_m
from learned.grasp.scenes import draw_scenes
from learned.grasp.settings import GripperGeometry
from tests.learned.grasp.layouts import PRODUCT, standing, walled

GRIPPER = GripperGeometry()
SPACING_M = 0.001


def grid(low: tuple[float, ...], high: tuple[float, ...]) -> Array:
    """Points (n, 2) of a rectangle, its rim included."""
    axes = [np.linspace(a, b, math.ceil((b - a) / SPACING_M) + 1) for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)


def touches(boxes: Boxes, required: int, neighbour: int, grow_m: float) -> bool:
    """Whether a sampled point of the gripper, on its way down or closing, is inside the neighbour's grown body."""
    width = boxes.size_m[required, 1]
    near, far = width / 2, width / 2 + GRIPPER.clearance_m + GRIPPER.finger_thickness_m + GRIPPER.margin_m
    half = GRIPPER.finger_width_m / 2 + GRIPPER.margin_m
    hand_across, hand_along = GRIPPER.hand_size_m
    top = boxes.bottom_m[neighbour] + boxes.size_m[neighbour, 2] + GRIPPER.below_gap_m
    tip = fingertip_height_m(boxes, GRIPPER)[required]
    outlines = [
        (tip, grid((-half, near), (half, far))),
        (tip, grid((-half, -far), (half, -near))),
        (tip + GRIPPER.finger_length_m, grid((-hand_along / 2, -hand_across / 2), (hand_along / 2, hand_across / 2))),
    ]
    for lowest, points in outlines:
        if top <= lowest:
            continue
        yaw = boxes.yaw_rad[required]
        turned = points @ np.array([[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]])
        offset = turned + boxes.centre_m[required] - boxes.centre_m[neighbour]
        yaw = boxes.yaw_rad[neighbour]
        inside = np.abs(offset @ np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]]))
        if np.any(np.all(inside < boxes.size_m[neighbour, :2] / 2 + grow_m, axis=1)):
            return True
    return False


def test_labels_agree_with_sampled_points() -> None:
    blocked = 0
    for scene in draw_scenes(PRODUCT, 11, 60, "test"):
        for i in range(len(scene.boxes)):
            for j in range(len(scene.boxes)):
                if i == j:
                    assert not scene.blocks[i, j]
                elif scene.blocks[i, j]:
                    # A rectangle's corner can reach in between the samples.
                    assert touches(scene.boxes, i, j, SPACING_M)
                    blocked += 1
                else:
                    assert not touches(scene.boxes, i, j, 0.0)
    assert blocked > 50


def test_a_part_under_the_hand_blocks_only_where_it_reaches_up_to_it() -> None:
    boxes = boxes_of((standing("o1", 0.0, 0.0), standing("o3", 0.055, 0.0, math.pi / 2)), PRODUCT)
    assert not blocking(boxes, GRIPPER)[0, 1]
    taller = replace(boxes, size_m=boxes.size_m + np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.03]]))
    assert blocking(taller, GRIPPER).tolist() == [[False, True], [False, False]]


def test_a_low_neighbour_does_not_block_a_tall_part() -> None:
    low = boxes_of(walled("o3", "o1"), PRODUCT)
    assert not blocking(low, GRIPPER)[0].any()
    assert blocking(low, GRIPPER)[1:, 0].all()


def test_a_gap_as_wide_as_finger_and_margin_is_enough() -> None:
    gap = GRIPPER.clearance_m + GRIPPER.finger_thickness_m + GRIPPER.margin_m
    for extra, blocked in ((0.001, False), (-0.001, True)):
        parts = (standing("o2", 0.0, 0.0), standing("o2", 0.0, 0.034 + gap + extra))
        assert blocking(boxes_of(parts, PRODUCT), GRIPPER)[0, 1] == blocked


def test_unknown_types_are_refused() -> None:
    with pytest.raises(ModelError, match=r"o9.*o1"):
        boxes_of((replace(standing("o1", 0.0, 0.0), part="o9"),), PRODUCT)
