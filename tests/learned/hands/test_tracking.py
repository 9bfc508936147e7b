"""Hands over time, with a reader that says what the test wants."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from cell.configuration import load_configuration
from cell.interfaces.errors import DeviceFault
from cell.interfaces.perception import Frame, HandSample
from cell.interfaces.pose import Array
from learned.classical.box_model import View
from learned.hands.reading import Reading
from learned.hands.regions import Image
from learned.hands.tracking import HandTracks

BENCH = load_configuration().bench
VIEW = View(BENCH.overhead.model, BENCH.overhead.mount.pose)
STEP_S = 1 / BENCH.overhead.rate_hz
HEIGHTS_M = (0.15, 0.08)
OFFSETS = {
    "palm": (0.11, 0.02),
    "pinch": (0.0, 0.0),
    "thumb": (0.0, -0.02),
    "index": (0.0, 0.02),
    "wrist": (0.18, 0.04),
}


def reading(tips_m: tuple[float, float], acting: float = 0.9, confidence: float = 0.95) -> Reading:
    points = {}
    for name, offset in OFFSETS.items():
        height = HEIGHTS_M[0 if name in ("palm", "wrist") else 1]
        points[name] = VIEW.pixels(np.array([[tips_m[0] + offset[0], tips_m[1] + offset[1], height]]))[0]
    left, top = points["pinch"] - 20
    return Reading(confidence, 0.1, acting, points, (left, top, left + 60, top + 90), HEIGHTS_M)


class Script:
    """Readings by frame."""

    def __init__(self, frames: Sequence[Sequence[Reading]]) -> None:
        self._frames = iter(frames)
        self.expected: list[Sequence[Array]] = []

    def read(self, image: Image, expected_px: Sequence[Array]) -> list[Reading]:
        assert image.shape == (BENCH.overhead.height_px, BENCH.overhead.width_px, 3)
        self.expected.append(list(expected_px))
        return list(next(self._frames))


def frame(number: int) -> Frame:
    image = np.zeros((BENCH.overhead.height_px, BENCH.overhead.width_px, 3), np.uint8)
    return Frame("overhead", number, number * STEP_S, image, BENCH.overhead.mount.pose)


def follow(script: Script, frames: int) -> tuple[list[HandSample | None], list[int]]:
    tracks = HandTracks(BENCH, script)
    samples, others = [], []
    for number in range(frames):
        samples.append(tracks.track(frame(number)))
        others.append(len(tracks.others))
    return samples, others


def test_points_are_put_on_the_bench_at_the_height_that_was_read() -> None:
    (sample,), _ = follow(Script([[reading((0.72, 0.1))]]), 1)
    assert sample is not None
    assert sample.fingertips_m == pytest.approx((0.72, 0.1))
    assert sample.palm_m == pytest.approx((0.83, 0.12))
    assert sample.height_m == pytest.approx(HEIGHTS_M[0])
    assert sample.forearm_rad == pytest.approx(np.arctan2(0.02, 0.07))
    assert (sample.side, sample.held_part, sample.held_m) == ("right", None, None)


def test_smoothing_calms_a_hand_at_rest_and_does_not_lag_behind_a_fast_one() -> None:
    rng = np.random.default_rng(0)
    still = [(0.72 + 0.003 * a, 0.1 + 0.003 * b) for a, b in rng.standard_normal((60, 2))]
    samples, _ = follow(Script([[reading(tips)] for tips in still]), 60)
    told = np.array([sample.fingertips_m for sample in samples if sample is not None])
    assert told[10:].std(axis=0).max() < 0.95 * np.std(np.array(still)[10:], axis=0).max()
    fast = [(0.95 - 0.04 * number, 0.1) for number in range(8)]  # 0.6 m/s
    samples, _ = follow(Script([[reading(tips)] for tips in fast]), 8)
    assert samples[-1] is not None
    assert samples[-1].fingertips_m[0] == pytest.approx(fast[-1][0], abs=0.006)


def test_the_reader_is_told_where_hands_should_be() -> None:
    script = Script([[reading((0.9 - 0.02 * number, 0.1))] for number in range(4)])
    follow(script, 4)
    assert script.expected[0] == []
    (expected,) = script.expected[3]
    assert np.allclose(expected, reading((0.84, 0.1)).centre_px, atol=1.0)


def test_the_hand_that_rests_is_another_one_and_does_not_take_over() -> None:
    rests = reading((1.0, -0.3), acting=0.2)
    unsure = [reading((0.72, 0.1), acting=0.45 if number > 3 else 0.9) for number in range(8)]
    samples, others = follow(Script([[rests, one] for one in unsure]), 8)
    assert all(sample is not None and sample.fingertips_m[0] < 0.8 for sample in samples)
    assert others == [1] * 8
    samples, others = follow(Script([[rests]] * 3), 3)
    assert samples == [None] * 3
    assert others == [1] * 3


def test_how_fast_a_hand_moves_is_known_of_every_hand() -> None:
    """Else the one that rests would count as the fastest, and the arm would wait for ever."""
    tracks = HandTracks(
        BENCH, Script([[reading((0.6 + 0.02 * step, 0.1)), reading((1.0, -0.3), acting=0.1)] for step in range(8)])
    )
    first, *_, last = [(tracks.track(frame(number)), *tracks.others) for number in range(8)]
    assert [hand and hand.velocity_m_s for hand in first] == [None, None]
    works, rests = [hand.velocity_m_s for hand in last if hand is not None]
    assert works == pytest.approx((0.02 / STEP_S, 0.0), abs=0.02)
    assert rests == pytest.approx((0.0, 0.0), abs=1e-6)


def test_a_doubtful_hand_is_believed_only_where_one_was() -> None:
    sure, doubtful = reading((0.72, 0.1)), reading((0.72, 0.1), confidence=0.4)
    samples, _ = follow(Script([[sure], [doubtful], [], [doubtful]]), 4)
    assert [sample is not None for sample in samples] == [True, True, False, True]
    samples, _ = follow(Script([[doubtful]] * 3), 3)
    assert samples == [None] * 3


def test_a_box_beyond_the_image_ends_at_its_edge() -> None:
    (sample,), _ = follow(Script([[replace(reading((0.72, 0.1)), box_px=(-30.0, 5.5, 700.0, 400.0))]]), 1)
    assert sample is not None
    assert sample.box_px == (0, 5, BENCH.overhead.width_px, BENCH.overhead.height_px)


def test_an_image_of_another_size_is_a_fault_of_the_camera() -> None:
    small = replace(frame(0), image=np.zeros((10, 10, 3), np.uint8))
    with pytest.raises(DeviceFault, match="10 x 10"):
        HandTracks(BENCH, Script([[]])).track(small)
