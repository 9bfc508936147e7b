"""Stacks of everyday objects: kinds, rest, relations by lifting, pictures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bracket_ground.interfaces.stacks import VMRD_CLASSES
from bracket_lab.stacks.draw import KINDS, Standing, depth, draw_stack, draw_thing, relations, stand
from bracket_sim.stacks.pieces import Thing, box, disc
from bracket_sim.stacks.settings import StackSettings
from bracket_sim.stacks.stacking import carriers_of
from bracket_sim.stacks.stage import Stage, table_with
from tests.benchmarks.stack_labels import order_of_taking

SLAB = Thing((box((0.2, 0.15, 0.03), (0, 0, 0.015), (0.5, 0.4, 0.3)), disc(0.02, 0.001, (0, 0, 0.03), (1, 1, 1))))
UPRIGHT = (1.0, 0.0, 0.0, 0.0)


def _stage(*places_m: tuple[float, float, float]) -> Stage:
    """Slabs whose bottoms are at these places, at rest."""
    stage = table_with([SLAB] * len(places_m), np.random.default_rng(0))
    for number, place in enumerate(places_m):
        stage.put(number, np.array(place), UPRIGHT)
    stage.run(0.3)
    return stage


def test_kinds_are_vmrds_in_its_order() -> None:
    assert KINDS == VMRD_CLASSES


@pytest.mark.parametrize("name", KINDS)
def test_each_kind_has_two_to_six_pieces_and_differs_from_copy_to_copy(name: str) -> None:
    first, second = (draw_thing(name, np.random.default_rng(seed)) for seed in (1, 2))
    assert 2 <= len(first.pieces) <= 6
    assert first != second
    assert draw_thing(name, np.random.default_rng(1)) == first


def test_what_lies_on_another_rests_on_it_also_by_way_of_a_third() -> None:
    stage = _stage((0, 0, 0), (0, 0, 0.031), (0, 0, 0.062), (0.3, 0, 0))
    assert carriers_of(stage) == [[], [0], [1], []]
    rests = relations(stage)
    assert rests is not None
    assert np.argwhere(rests).tolist() == [[1, 0], [2, 0], [2, 1]]
    assert depth(rests) == 2
    assert list(order_of_taking(rests, 0)) == [2, 1]


def test_a_bridge_rests_on_both() -> None:
    stage = _stage((-0.12, 0, 0), (0.12, 0, 0), (0, 0, 0.031))
    rests = relations(stage)
    assert rests is not None
    assert np.argwhere(rests).tolist() == [[2, 0], [2, 1]]


def test_side_by_side_nothing_rests_on_anything() -> None:
    rests = relations(_stage((0, 0, 0), (0.205, 0, 0)))
    assert rests is not None
    assert not rests.any()


def test_trials_leave_everything_where_it_was() -> None:
    stage = _stage((0, 0, 0), (0, 0, 0.031))
    before = stage.data.qpos.copy()
    relations(stage)
    assert np.array_equal(stage.data.qpos, before)


def test_labels_stay_within_what_was_asked_for() -> None:
    flat = StackSettings(stacked_share=0.0)
    shallow = StackSettings(deepest=1, fewest=3, stacked_share=1.0)
    assert all(not stand(number, flat).rests.any() for number in range(2))
    assert all(depth(stand(number, shallow).rests) <= 1 for number in range(2))


def test_few_kinds_are_the_first_ones() -> None:
    for number in range(4):
        assert set(stand(number, StackSettings(kinds=5)).names) <= set(VMRD_CLASSES[:5])


def test_a_picture_is_drawn_again_from_its_number() -> None:
    first, second = (draw_stack(3, StackSettings()) for _ in range(2))
    assert first.scene == second.scene
    assert np.array_equal(first.image, second.image)
    assert draw_stack(3, StackSettings(), seed=1).scene != first.scene


def test_boxes_and_relations_of_a_picture_fit_together() -> None:
    drawn = draw_stack(11, StackSettings(fewest=3, stacked_share=1.0))
    by_index = {item.index: item for item in drawn.scene.objects}
    height, width = drawn.image.shape[:2]
    for item in drawn.scene.objects:
        left, top, right, bottom = item.box_px
        assert 0 <= left < right <= width
        assert 0 <= top < bottom <= height
        assert all(item.index in by_index[father].children for father in item.fathers)
        assert item.top_m is not None
    assert any(item.fathers for item in drawn.scene.objects)


def test_objects_that_were_taken_away_carry_nothing() -> None:
    stage = _stage((0, 0, 0), (0, 0, 0.031))
    stage.take_away(1)
    assert relations(stage) is not None
    assert not carriers_of(stage)[1]


def test_a_standing_stack_is_at_rest() -> None:
    standing: Standing = stand(5, StackSettings())
    before = standing.stage.data.qpos.copy()
    standing.stage.run(0.5)
    assert np.abs(standing.stage.data.qpos - before).max() < 0.003
    assert replace(standing) == standing
