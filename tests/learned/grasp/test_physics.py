"""Labels agree with a brute-force check that samples points of the moving fingers and of the palm."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from bracket_cell.learned.grasp.boxes import Boxes, boxes_of
from bracket_cell.learned.grasp.candidates import (
    CANDIDATES,
    PLACE_M,
    SIDE,
    as_headed,
    available,
    clearance_m,
    fingertips_m,
    graspable,
    gripped_m,
    jaw_yaw_rad,
    touching,
)
from bracket_cell.learned.grasp.settings import WITH_MARGINS, GripperOutline
from bracket_ground.interfaces.grasping import places_m
from bracket_ground.interfaces.pose import Array
from bracket_lab.learned.grasp.scenes import draw_scenes
from tests.learned.grasp.layouts import PRODUCT, can_grasp, standing, walled

OUTLINE = GripperOutline()
SPACING_M = 0.001


def grid(low: tuple[float, float], high: tuple[float, float]) -> Array:
    """Points (n, 2) of a rectangle, its rim included."""
    axes = [np.linspace(a, b, math.ceil((b - a) / SPACING_M) + 1) for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)


def sampled_touch(boxes: Boxes, part: int, candidate: int, neighbour: int, grow_m: float) -> bool:
    """Whether a point of the gripper, coming down or closing, is at some time inside the neighbour's grown body."""
    near = gripped_m(boxes)[part, candidate] / 2
    far = near + OUTLINE.clearance_m + OUTLINE.pad_size_m[0]
    half = OUTLINE.pad_size_m[1] / 2
    palm_across, palm_along = OUTLINE.palm_size_m
    tip = fingertips_m(boxes, OUTLINE)[part]
    bodies = [
        (tip, grid((-half, near), (half, far))),
        (tip, grid((-half, -far), (half, -near))),
        (tip + OUTLINE.palm_above_tip_m, grid((-palm_along / 2, -palm_across / 2), (palm_along / 2, palm_across / 2))),
    ]
    top = boxes.top_m[neighbour] - OUTLINE.fitting_m + grow_m
    own, other = jaw_yaw_rad(boxes)[part, candidate], boxes.yaw_rad[neighbour]
    for lowest, points in bodies:
        placed = points + np.array([PLACE_M[candidate], 0.0])
        turned = placed @ np.array([[math.cos(own), math.sin(own)], [-math.sin(own), math.cos(own)]])
        offset = turned + boxes.centre_m[part] - boxes.centre_m[neighbour]
        seen = np.abs(offset @ np.array([[math.cos(other), -math.sin(other)], [math.sin(other), math.cos(other)]]))
        if top > lowest and np.any(np.all(seen < boxes.size_m[neighbour, :2] / 2 + grow_m, axis=1)):
            return True
    return False


def test_labels_agree_with_sampled_points() -> None:
    blocked = 0
    for scene in draw_scenes(PRODUCT, 11, 40, "test"):
        exists = available(scene.boxes, OUTLINE)
        for i, candidate, j in np.ndindex(*scene.blocks.shape):
            if i == j or not exists[i, candidate]:
                assert scene.blocks[i, candidate, j] == (i == j and not exists[i, candidate])
            elif scene.blocks[i, candidate, j]:
                # A rectangle's corner can reach in between the samples.
                assert sampled_touch(scene.boxes, i, candidate, j, SPACING_M)
                blocked += 1
            else:
                assert not sampled_touch(scene.boxes, i, candidate, j, 0.0)
    assert blocked > 50


def test_what_touches_blocks_the_cautious_rule_too() -> None:
    for scene in draw_scenes(PRODUCT, 12, 100, "test"):
        assert not np.any(scene.blocks & ~touching(scene.boxes, WITH_MARGINS))


def test_options_are_those_that_the_jaw_opens_wide_enough_for() -> None:
    boxes = boxes_of(tuple(standing(name, 0.3 * k, 0.0) for k, name in enumerate(PRODUCT.parts)), PRODUCT)
    assert available(boxes, OUTLINE).tolist() == [8 * [True], 8 * [True], (SIDE == 0).tolist()]
    assert touching(boxes, OUTLINE)[2].tolist() == [[False, False, bool(side)] for side in SIDE]
    assert graspable(touching(boxes, OUTLINE)).all()


def test_candidates_are_at_the_places_where_the_skills_hold_parts() -> None:
    for axis, closing in ((0, SIDE == 1), (1, SIDE == 0)):
        assert sorted(PLACE_M[closing]) == pytest.approx(sorted(places_m(axis)))


def test_half_way_to_an_end_there_is_room_where_there_is_none_in_the_middle_or_at_the_end() -> None:
    parts = (standing("o2", 0.0, 0.0), standing("o2", 0.066, -0.026), standing("o2", 0.066, 0.040))
    boxes = boxes_of(parts, PRODUCT)
    ends = [name for name in CANDIDATES if name.startswith("length") and can_grasp(boxes, 0, name)]
    assert ends == ["length+half"]


def test_a_wall_along_the_sides_leaves_the_ends() -> None:
    boxes = boxes_of(walled("o1", "o3"), PRODUCT)
    assert [name for name in CANDIDATES if can_grasp(boxes, 0, name)] == ["length", "length+half", "length-half"]


def test_a_neighbour_at_one_end_leaves_the_other_end() -> None:
    parts = (standing("o2", 0.0, 0.0), standing("o3", 0.085, 0.0), standing("o2", -0.02, 0.055, math.pi / 2))
    boxes = boxes_of(parts, PRODUCT)
    free = [name for name in CANDIDATES if can_grasp(boxes, 0, name)]
    assert free == ["width+"]
    turned = boxes_of((standing("o2", 0.0, 0.0, math.pi), *parts[1:]), PRODUCT)
    assert [name for name in CANDIDATES if can_grasp(turned, 0, name)] == ["width-"]
    assert np.array_equal(as_headed(touching(boxes, OUTLINE), boxes, turned)[0], touching(turned, OUTLINE)[0])


def test_a_low_neighbour_does_not_block_a_tall_part() -> None:
    blocks = touching(boxes_of(walled("o3", "o1"), PRODUCT), OUTLINE)
    assert not blocks[0, 0].any()
    assert blocks[1:, 0, 0].all()


def test_a_gap_as_wide_as_the_finger_needs_is_enough() -> None:
    gap = OUTLINE.clearance_m + OUTLINE.pad_size_m[0]
    for extra, blocked in ((0.0005, False), (-0.0005, True)):
        boxes = boxes_of((standing("o2", 0.0, 0.0), standing("o2", 0.0, 0.034 + gap + extra)), PRODUCT)
        assert touching(boxes, OUTLINE)[0, 0, 1] == blocked
        assert clearance_m(boxes, OUTLINE)[0, 0, 1] == pytest.approx(extra)


def test_a_part_under_the_palm_blocks_only_where_it_reaches_up_to_it() -> None:
    boxes = boxes_of((standing("o1", 0.0, 0.0), standing("o3", 0.050, 0.0, math.pi / 2)), PRODUCT)
    assert not touching(boxes, OUTLINE)[0, 0, 1]
    taller = replace(boxes, size_m=boxes.size_m + np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.03]]))
    assert touching(taller, OUTLINE)[0, 0, 1]
