"""Depths as a cue: how high palm and fingertips are, and what rises over the bench that colours do not show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from bracket_cell.configuration import load_configuration
from bracket_cell.learned.classical.box_model import View, check_image
from bracket_cell.learned.classical.depth_evidence import DepthEvidence
from bracket_cell.learned.hands.depth import MISSING, UNDER_NAIL_M, UNDER_SKIN_M, DepthUnderHands, heights_by_depth
from bracket_cell.learned.hands.reading import Reading
from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import HandSample

BENCH = load_configuration().bench
PALM, THUMB, INDEX = np.array([240.0, 200.0]), np.array([228.0, 150.0]), np.array([250.0, 150.0])


def reading() -> Reading:
    points = {"palm": PALM, "pinch": (THUMB + INDEX) / 2, "thumb": THUMB, "index": INDEX, "wrist": PALM * 1.2}
    return Reading(1.0, 0.0, 1.0, points, (200.0, 130.0, 280.0, 260.0), (0.1, 0.05))


def depths(palm_m: float, tips_m: float) -> NDArray[np.uint16]:
    """A table with a hand on it whose skin is so high; the camera looks straight down."""
    setup = BENCH.overhead
    away = np.full((setup.height_px, setup.width_px), setup.mount.position_m[2])
    away[170:230, 215:265] -= palm_m
    away[140:160, 215:265] -= tips_m
    return np.rint(1e3 * away).astype(np.uint16)


def seen(depth_mm: NDArray[np.uint16] | None) -> tuple[Frame, View]:
    setup = BENCH.overhead
    image = np.zeros((setup.height_px, setup.width_px, 3), np.uint8)
    frame = Frame("overhead", 0, 0.0, image, setup.mount.pose, depth_mm=depth_mm)
    return frame, View.of(setup.model, frame)


def test_heights_are_those_of_the_depth_image() -> None:
    frame, view = seen(depths(0.15, 0.09))
    palm, tips = heights_by_depth(frame, view, reading(), (0.10, 0.05))
    assert palm == pytest.approx(0.15 - UNDER_SKIN_M, abs=0.004)
    assert tips == pytest.approx(0.09 - UNDER_NAIL_M, abs=0.004)


def test_the_guess_stays_where_depth_tells_nothing_or_of_something_else() -> None:
    guess = 0.10, 0.05
    blind = np.zeros((BENCH.overhead.height_px, BENCH.overhead.width_px), np.uint16)
    for depth_mm in (None, blind, depths(0.45, 0.45)):  # the last: an arm over the hand
        frame, view = seen(depth_mm)
        assert heights_by_depth(frame, view, reading(), guess) == guess


def test_no_depth_under_a_hand_is_told_after_half_a_second_and_no_longer_than_it_is_so() -> None:
    known, hole = depths(0.15, 0.09), depths(0.15, 0.09)
    hole[170:230, 215:265] = 0
    under = DepthUnderHands(BENCH)
    palm_m = View.of(BENCH.overhead.model, seen(None)[0]).on_plane(PALM[np.newaxis], 0.13)[0]
    hand = HandSample(0.0, (200, 130, 280, 260), (0.9, 0.0), (float(palm_m[0]), float(palm_m[1])), height_m=0.13)

    def told(time_s: float, depth_mm: NDArray[np.uint16] | None, hands: tuple[HandSample, ...] = (hand,)) -> str:
        return under.judge(replace(seen(depth_mm)[0], time_s=time_s), hands)

    assert [told(0.0, known), told(1.0, hole), told(1.3, hole)] == [""] * 3
    assert told(1.6, hole) == MISSING
    assert told(1.7, known) == ""
    assert [told(time_s, None) for time_s in (2.0, 3.0)] == [""] * 2
    assert [told(time_s, hole, ()) for time_s in (4.0, 5.0)] == [""] * 2


def test_fingertips_that_are_hidden_follow_the_palm() -> None:
    depth_mm = depths(0.15, 0.0)  # where the fingertips should be, the table is seen
    frame, view = seen(depth_mm)
    palm, tips = heights_by_depth(frame, view, reading(), (0.10, 0.06))
    assert tips == pytest.approx(palm - 0.04)


def test_an_arm_that_colours_do_not_show_rises_over_the_bench() -> None:
    evidence, hidden = (
        DepthEvidence(BENCH),
        np.zeros((BENCH.overhead.height_px // 4, BENCH.overhead.width_px // 4), bool),
    )
    empty = depths(0.0, 0.0)
    for _ in range(6):
        risen = evidence.risen(empty, hidden)
        assert risen is not None
        assert not risen.any()
    arm = depths(0.12, 0.12)
    shown = evidence.risen(arm, hidden)
    assert shown is not None
    assert shown.any()
    hidden[30:60, 50:70] = True  # a hand is seen there
    explained = evidence.risen(arm, hidden)
    assert explained is not None
    assert not explained.any()
    part = empty.copy()
    part[200:220, 200:220] -= 75
    small = evidence.risen(part, np.zeros_like(hidden))
    assert small is not None
    assert not small.any(), "a part that was set down"


def test_a_camera_that_knows_no_depth_is_told() -> None:
    blind = np.zeros((BENCH.overhead.height_px, BENCH.overhead.width_px), np.uint16)
    assert DepthEvidence(BENCH).risen(blind, np.zeros((90, 120), bool)) is None


def test_depths_of_another_kind_are_refused() -> None:
    frame, _ = seen(None)
    wrong = np.zeros((BENCH.overhead.height_px, BENCH.overhead.width_px), np.float32)
    broken = Frame("overhead", 0, 0.0, frame.image, frame.world_from_camera, depth_mm=wrong)  # type: ignore[arg-type]
    with pytest.raises(DeviceFault, match="uint16"):
        check_image(BENCH.overhead.model, broken)
