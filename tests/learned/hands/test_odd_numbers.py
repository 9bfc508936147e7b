"""What networks, depth images or a tracker of somebody's own tell: a number that is none never becomes a place."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.learned.bench_watcher import DetectorChain
from bracket_cell.learned.hands.depth import BELIEVED_M, heights_by_depth
from bracket_cell.learned.hands.height import PalmLength
from bracket_cell.learned.hands.reading import ApparentSize, Reading, over_table
from bracket_cell.learned.hands.tracking import HandTracks
from bracket_cell.skills.motion.known_bench import Implausible, KnownBench, ViewRange
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import Action, BenchView, HandSample, HoleView, Segment
from tests.learned.hands.test_tracking import BENCH, HEIGHTS_M, STEP_S, VIEW, Script, frame, reading

RANGE = ViewRange(BENCH)
SIZE = ApparentSize(math.log(0.063 / 1.3), 0.05, (0.02, 0.02))
SOUND = replace(reading((0.72, 0.1)), size=SIZE)


def doubt(hand: HandSample, time_s: float) -> str:
    return RANGE.doubt(BenchView(0, time_s, hand, {}, Action("idle", 1.0)), time_s)


def spoilt(name: str, place: int, value: float) -> Reading:
    """A sound reading with one other number."""
    if name in ("palm", "pinch"):
        point = SOUND.points_px[name].copy()
        point[place] = value
        return replace(SOUND, points_px={**SOUND.points_px, name: point})
    if name == "heights_m":
        return replace(SOUND, heights_m=(value, HEIGHTS_M[1]) if place == 0 else (HEIGHTS_M[0], value))
    if name == "height_errors_m":
        return replace(SOUND, size=replace(SIZE, height_errors_m=(value, 0.02) if place == 0 else (0.02, value)))
    changes: dict[str, Any] = {name: value}
    return replace(SOUND, size=replace(SIZE, **changes))


NAMES = st.sampled_from(["palm", "pinch", "heights_m", "height_errors_m", "log_angle", "angle_error"])


@given(NAMES, st.integers(0, 1), st.just(math.nan) | st.floats(width=32))
@settings(max_examples=300, deadline=None)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_a_reading_that_is_no_number_is_no_hand_that_separation_believes(name: str, place: int, value: float) -> None:
    script = Script([[SOUND], [spoilt(name, place, value)], [SOUND]])
    tracks = HandTracks(BENCH, script, PalmLength(math.log(0.063), 0.01))
    assert tracks.track(frame(0)) is not None
    for number in (1, 2):
        try:
            hand = tracks.track(frame(number))
        except (ArithmeticError, ValueError):  # the detector is lost then: the run stops
            return
        if hand is None:  # it vanished inside the view, which holds
            continue
        words = doubt(hand, number * STEP_S)
        if number == 1 and math.isnan(value):
            assert words
        if not words:
            assert hand.height_m is not None
            assert math.isfinite(hand.height_m)


@given(st.floats())
def test_what_is_no_height_does_not_become_that_of_the_table(height_m: float) -> None:
    found = over_table(height_m)
    assert math.isnan(found) if math.isnan(height_m) else found == max(0.0, height_m)


@given(st.integers(0, 65535), st.floats(0.0, 0.5) | st.just(math.nan), st.floats(0.0, 0.5) | st.just(math.nan))
@settings(max_examples=200, deadline=None)
def test_no_depth_image_makes_a_height_of_what_is_none(depth_mm: int, palm_m: float, tips_m: float) -> None:
    image = np.full((BENCH.overhead.height_px, BENCH.overhead.width_px), depth_mm, np.uint16)
    seen = replace(frame(0), depth_mm=image)
    palm, tips = heights_by_depth(seen, VIEW, SOUND, (palm_m, tips_m))
    assert math.isnan(palm) == math.isnan(palm_m)
    assert math.isnan(palm) or abs(palm - palm_m) <= BELIEVED_M
    assert not (math.isnan(tips_m) and math.isnan(palm_m)) or math.isnan(tips)


class OwnTracker:
    """Somebody's own, with readers of holes and actions that see nothing."""

    def __init__(self, hands: list[HandSample], others: tuple[HandSample, ...] = ()) -> None:
        self._hands, self.others = iter(hands), others

    def track(self, _: Frame) -> HandSample | None:
        return next(self._hands)

    def read(self, *_: object) -> Mapping[str, HoleView]:
        return {}

    def detect(self, _: Segment, __: Mapping[str, HoleView]) -> Action:
        return Action("idle", 1.0)


OWN = HandSample(0.0, (200, 100, 290, 230), (0.7, 0.1), (0.8, 0.1), height_m=0.1, fingertips_height_m=0.1)
ODD: tuple[Any, ...] = (math.nan, math.inf, -math.inf, 1e9, -5.0, None, "")


@pytest.mark.parametrize("value", ODD)
@pytest.mark.parametrize("name", ["palm_m", "fingertips_m", "height_m", "fingertips_height_m", "time_s", "confidence"])
def test_a_tracker_of_somebodys_own_makes_no_hand_that_cannot_be(name: str, value: Any) -> None:
    if name.endswith("height_m") and value is None:  # a tracker that does not tell it
        return
    changes: dict[str, Any] = {name: (value, 0.1) if name in ("palm_m", "fingertips_m") else value}
    odd = replace(OWN, **changes)
    product = load_product(load_configuration())
    for main, others in ((odd, ()), (OWN, (odd,))):
        own = OwnTracker([main], others)
        try:
            view = DetectorChain(BENCH, product, own, own, own).watch(frame(0))
        except (TypeError, ValueError):  # the detector is lost then: the run stops
            continue
        with pytest.raises(Implausible):
            KnownBench(RANGE, view, view.time_s)
