"""Networks see the same of a segment in training and in a run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.learned.actions.segments import CROP_PX, LONG_S, SegmentReader, middle
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.hand_window import hand_window, last_at_hole, window_px
from bracket_ground.interfaces.perception import SEGMENT_FRAMES, HandSample, Segment
from bracket_ground.interfaces.pose import Array
from bracket_lab.learned.actions.variation import Variation, varied_track

CONFIGURATION = load_configuration()
BENCH, PRODUCT = CONFIGURATION.bench, load_product(CONFIGURATION)
READER = SegmentReader(BENCH, PRODUCT)
CAMERA = BENCH.overhead


def segment(tips_m: Array) -> Segment:
    """One frame for each pair of fingertips (n, 2), NaN for no hand; frame i has the grey level i + 1."""
    frames, hands = [], []
    for index, (x, y) in enumerate(tips_m):
        image = np.full((CAMERA.height_px, CAMERA.width_px, 3), index + 1, np.uint8)
        frames.append(Frame("overhead", index, index / 15, image, CAMERA.mount.pose))
        hands.append(None if np.isnan(x) else HandSample(index / 15, (0, 0, 9, 9), (x, y), (x + 0.1, y)))
    return Segment(tuple(frames), tuple(hands))


def way(*, leaves: bool = True) -> Array:
    """From far away to the third hole, and away again; the last frame without a hand."""
    hole = READER.holes_m[2]
    far = hole + np.array([0.25, 0.1])
    tips = np.concatenate([np.linspace(far, hole, 30), np.linspace(hole, far, 15)]) if leaves else np.tile(far, (45, 1))
    tips[-1] = np.nan
    return tips


def test_the_second_crop_is_of_the_last_moment_at_a_hole() -> None:
    tips = way()
    found = READER.read(segment(tips))
    at_hole = last_at_hole(tips, READER.holes_m)
    assert at_hole is not None
    assert found.at_hole == at_hole
    assert (
        np.linalg.norm(tips[at_hole] - READER.holes_m[2])
        < 0.05
        <= np.linalg.norm(tips[at_hole + 1] - READER.holes_m[2])
    )
    assert found.crops[1].max() == at_hole + 1
    assert found.crops[0].max() == 0  # no hand in the last frame
    assert READER.read(segment(way(leaves=False))).at_hole is None


def test_track_is_told_in_the_bracket_s_frame_and_goes_on_where_no_hand_is_seen() -> None:
    tips = way()
    found = READER.read(segment(tips)).track
    assert found.shape[1] == SEGMENT_FRAMES
    assert found[4].tolist() == [1.0] * 44 + [0.0]
    assert np.array_equal(found[:4, -1], found[:4, -2])
    known = np.full((len(READER.holes_m), 2), (0.08, 0.03))
    holes = np.hstack([READER.holes_m, READER.holes_m, known])
    moved = READER.track(np.vstack([holes[:1], holes]), 0.1, None)
    assert np.abs(moved[:2]).max() == pytest.approx(1.0, abs=0.01)  # the outer holes are 0.2 m from the middle
    assert moved[6:8, 0] == pytest.approx([1.0, 0.5])
    assert not found[6:8].any()  # this tracker tells no heights


def test_a_hand_that_nobody_sees_stays_where_it_was_last_seen_and_that_gets_older() -> None:
    hole = READER.holes_m[2]
    hand = HandSample(-2.0, (0, 0, 9, 9), (float(hole[0]), float(hole[1])), (float(hole[0]) + 0.1, float(hole[1])))
    lost = segment(np.full((SEGMENT_FRAMES, 2), np.nan))
    found = READER.read(replace(lost, before=hand))
    there = READER.read(segment(np.tile(hole, (SEGMENT_FRAMES, 1)))).track
    assert found.track[:4] == pytest.approx(there[:4], abs=1e-6)
    assert not found.track[4].any()
    assert not there[8].any()
    ago_s = 2.0 + np.arange(SEGMENT_FRAMES) / CAMERA.rate_hz
    assert found.track[8] * LONG_S == pytest.approx(ago_s, abs=1e-3)
    assert found.at_hole is None  # that was before
    assert (READER.read(lost).track[8] == 1.0).all()
    again = np.full((SEGMENT_FRAMES, 2), np.nan)
    again[30:] = hole + 0.2
    track = READER.read(replace(segment(again), before=hand)).track
    assert track[:4, 29] == pytest.approx(there[:4, 0], abs=1e-6)
    assert not track[8, 30:].any()
    first = READER.read(segment(again)).track  # never seen before: where it is seen first, of unknown age
    assert first[:4, 0] == pytest.approx(first[:4, 44])
    assert first[8].tolist() == [1.0] * 30 + [0.0] * 15


def test_short_and_empty_segments_have_inputs() -> None:
    assert READER.read(segment(way()[:3])).track.shape[1] == SEGMENT_FRAMES
    nothing = READER.read(segment(np.full((4, 2), np.nan)))
    assert not nothing.crops.any()
    assert np.isfinite(nothing.track).all()


def test_windows_are_black_beyond_the_image_and_crops_have_one_size() -> None:
    image = np.full((CAMERA.height_px, CAMERA.width_px, 3), 200, np.uint8)
    side = window_px(CAMERA)
    corner = hand_window(image, (0.0, 0.0), side)
    assert corner.shape == (side, side, 3)
    assert 0.2 < (corner > 0).mean() < 0.3
    assert not hand_window(image, (-500.0, -500.0), side).any()
    for size in (side, 130, 71):
        assert middle(np.zeros((size, size, 3), np.uint8)).shape == (CROP_PX, CROP_PX, 3)


def test_some_tracks_to_learn_from_are_much_worse_than_most() -> None:
    still = np.column_stack([np.tile(READER.holes_m[2], (45, 2)), np.full(45, 0.05), np.full(45, 0.03)])

    def off_m(worse: float) -> float:
        rng, variation = np.random.default_rng(0), Variation(worse=worse, lost=0.0)
        tracks = [varied_track(still, READER, rng, variation)[:, :2] for _ in range(200)]
        return float(np.median([np.linalg.norm(track.mean(axis=0) - still[0, :2]) for track in tracks]))

    assert off_m(0.0) < 0.01
    assert off_m(1.0) > 2 * off_m(0.0)
    assert off_m(0.0) < off_m(Variation().worse) < 0.5 * off_m(1.0)
