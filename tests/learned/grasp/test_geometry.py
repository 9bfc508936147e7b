"""The rule's margins, and the boxes that it reads."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from bracket_cell.learned.grasp.boxes import boxes_of
from bracket_cell.learned.grasp.candidates import graspable, touching
from bracket_cell.learned.grasp.settings import WITH_MARGINS
from bracket_ground.errors import ModelError
from tests.learned.grasp.layouts import PRODUCT, standing, walled


def test_a_part_under_the_hand_blocks_only_where_it_reaches_up_to_it() -> None:
    boxes = boxes_of((standing("o1", 0.0, 0.0), standing("o3", 0.055, 0.0, math.pi / 2)), PRODUCT)
    assert not touching(boxes, WITH_MARGINS)[0, 0, 1]
    taller = replace(boxes, size_m=boxes.size_m + np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.03]]))
    assert touching(taller, WITH_MARGINS)[0, 0].tolist() == [False, True]


def test_a_low_neighbour_does_not_block_a_tall_part() -> None:
    low = touching(boxes_of(walled("o3", "o1"), PRODUCT), WITH_MARGINS)
    assert not low[0, 0].any()
    assert low[1:, 0, 0].all()


def test_a_gap_as_wide_as_finger_and_margin_is_enough() -> None:
    gap = WITH_MARGINS.clearance_m + WITH_MARGINS.pad_size_m[0] + WITH_MARGINS.margin_m
    for extra, blocked in ((0.001, False), (-0.001, True)):
        parts = (standing("o2", 0.0, 0.0), standing("o2", 0.0, 0.034 + gap + extra))
        assert touching(boxes_of(parts, PRODUCT), WITH_MARGINS)[0, 0, 1] == blocked


def test_a_longer_stroke_gives_more_options() -> None:
    boxes = boxes_of(walled("o3", "o3"), PRODUCT)
    assert not graspable(touching(boxes, WITH_MARGINS))[0]
    assert graspable(touching(boxes, WITH_MARGINS.model_copy(update={"stroke_m": 0.1})))[0]


def test_unknown_types_are_refused() -> None:
    with pytest.raises(ModelError, match=r"o9.*o1"):
        boxes_of((replace(standing("o1", 0.0, 0.0), part="o9"),), PRODUCT)
