"""The hand is found by its skin, and the part between its fingers by its colour."""

import numpy as np
import pytest

from bracket_cell.learned.classical.colour import ColourModel
from bracket_cell.learned.classical.hand_tracker import ClassicalHandTracker
from bracket_cell.learned.classical.settings import PerceptionSettings
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import HandSample
from tests.learned.classical.scenes import BENCH, PRODUCT, SKIN, Canvas, bench_canvas, draw_hand, in_hole

TIPS = [(0.72, 0.14), (0.80, 0.30), (0.95, -0.05)]


def track(canvas: Canvas) -> HandSample | None:
    tracker = ClassicalHandTracker(BENCH, PRODUCT, PerceptionSettings(), ColourModel(PRODUCT, SKIN))
    image = canvas.image(np.random.default_rng(3))
    return tracker.track(Frame("overhead", 0, 0.0, image, BENCH.overhead.mount.pose))


@pytest.mark.parametrize("tips", TIPS)
def test_fingertips_and_palm_are_where_they_were_drawn(tips: tuple[float, float]) -> None:
    canvas = bench_canvas()
    draw_hand(canvas, tips)
    hand = track(canvas)
    assert hand is not None
    assert np.allclose(hand.fingertips_m, tips, atol=0.005)
    assert np.allclose(hand.palm_m, (tips[0] + 0.11, tips[1]), atol=0.015)
    assert hand.held_part is None


@pytest.mark.parametrize("name", list(PRODUCT.parts))
@pytest.mark.parametrize("tips", TIPS)
def test_the_held_part_is_named_and_in_the_box(name: str, tips: tuple[float, float]) -> None:
    canvas = bench_canvas()
    bare = bench_canvas()
    canvas.part((name, tips[0] - 0.005, tips[1], 0.0, 0.10 - PRODUCT.parts[name].size_m[2] / 2))
    for one in (canvas, bare):
        draw_hand(one, tips)
    holding, empty = track(canvas), track(bare)
    assert holding is not None
    assert empty is not None
    assert holding.held_part == name
    assert holding.box_px[1] < empty.box_px[1]


def test_parts_that_stand_are_not_held() -> None:
    canvas = bench_canvas()
    canvas.parts([in_hole("o2", "p2"), in_hole("o3", "p4"), in_hole("o1", "p3")])
    draw_hand(canvas, (0.86, 0.18))
    hand = track(canvas)
    assert hand is not None
    assert hand.held_part is None


def test_no_hand_no_sample() -> None:
    canvas = bench_canvas()
    canvas.parts([in_hole("o1", position) for position in PRODUCT.positions])
    assert track(canvas) is None
