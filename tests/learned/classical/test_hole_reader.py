"""Holes are read from drawn benches, and not misread while something is in the way."""

import numpy as np
import pytest

from bracket_cell.learned.classical.colour import ColourModel
from bracket_cell.learned.classical.hole_reader import ClassicalHoleReader
from bracket_cell.learned.classical.settings import PerceptionSettings
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import HoleView
from tests.learned.classical.scenes import BENCH, PRODUCT, SKIN, Canvas, bench_canvas, draw_hand, hole_m, in_hole

ABOVE = np.array([0.0, 0.0, 0.2])
SETTINGS = PerceptionSettings()


class Reading:
    """A reader and the frames it is shown."""

    def __init__(self) -> None:
        self._reader = ClassicalHoleReader(BENCH, PRODUCT, SETTINGS, ColourModel(PRODUCT, SKIN))
        self._rng = np.random.default_rng(2)
        self._sequence = 0

    def show(self, canvas: Canvas, frames: int = SETTINGS.settle_frames) -> dict[str, HoleView]:
        for _ in range(frames):
            image = canvas.image(self._rng, gain=float(self._rng.normal(1.0, 0.02)))
            time_s = self._sequence / BENCH.overhead.rate_hz
            frame = Frame("overhead", self._sequence, time_s, image, BENCH.overhead.mount.pose)
            self._sequence += 1
            views = dict(self._reader.read(frame, None))
        return views


def test_empty_holes_are_empty() -> None:
    views = Reading().show(bench_canvas())
    assert set(views) == set(PRODUCT.positions)
    assert all(view.part is None for view in views.values())


@pytest.mark.parametrize("goal", list(PRODUCT.goals))
def test_a_finished_bracket_is_read(goal: str) -> None:
    canvas = bench_canvas()
    placements = PRODUCT.goal_placements(goal)
    canvas.parts([in_hole(part, position, yaw_rad=0.04) for position, part in placements.items()])
    views = Reading().show(canvas)
    assert {position: view.part for position, view in views.items()} == placements
    assert all(view.upright for view in views.values())


@pytest.mark.parametrize("name", list(PRODUCT.parts))
def test_a_part_beside_its_hole_is_not_upright(name: str) -> None:
    canvas = bench_canvas()
    canvas.part(in_hole(name, "p2", shift_m=(0.0, 0.015)))
    view = Reading().show(canvas)["p2"]
    assert (view.part, view.upright) == (name, False)


def test_a_view_changes_only_after_several_equal_readings() -> None:
    reading, filled = Reading(), bench_canvas()
    filled.part(in_hole("o2", "p3"))
    reading.show(bench_canvas())
    assert reading.show(filled, SETTINGS.settle_frames - 1)["p3"].part is None
    assert reading.show(filled, 1)["p3"].part == "o2"


def test_a_part_between_fingers_does_not_stand_in_the_hole() -> None:
    reading, held = Reading(), bench_canvas()
    before = reading.show(bench_canvas())["p4"]
    x_m, y_m, _ = hole_m("p4")
    held.part(in_hole("o1", "p4"))
    draw_hand(held, (float(x_m), float(y_m)), height_m=0.06)
    after = reading.show(held, 8)["p4"]
    assert after == before


def test_a_covered_hole_keeps_what_was_seen() -> None:
    reading, filled, covered = Reading(), bench_canvas(), bench_canvas()
    filled.part(in_hole("o2", "p5"))
    before = reading.show(filled)["p5"]
    covered.part(in_hole("o2", "p5"))
    covered.disc(hole_m("p5") + ABOVE, 0.05, np.full(3, 0.15))  # as dark as a gripper
    after = reading.show(covered, 8)
    assert after["p5"] == before
    assert after["p1"].seen_s > before.seen_s


def test_a_dark_thing_over_an_empty_hole_says_nothing() -> None:
    reading, covered = Reading(), bench_canvas()
    covered.disc(hole_m("p5") + ABOVE, 0.05, np.full(3, 0.1))
    assert "p5" not in reading.show(covered, 8)
