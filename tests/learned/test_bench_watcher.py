"""What an action detector is shown of the stream of frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.learned.bench_watcher import DetectorChain
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import SEGMENT_FRAMES, Action, HandSample, HoleView, Segment

CONFIGURATION = load_configuration()
BENCH, PRODUCT = CONFIGURATION.bench, load_product(CONFIGURATION)
HAND = HandSample(0.0, (10, 10, 60, 60), (0.7, 0.1), (0.8, 0.1))


class Everything:
    """Sees a hand in all frames but some, no holes, and keeps the segments that it is asked about."""

    others: tuple[HandSample, ...] = ()

    def __init__(self, unseen: Sequence[int] = ()) -> None:
        self.segments: list[Segment] = []
        self._unseen = unseen

    def track(self, frame: Frame) -> HandSample | None:
        return None if frame.sequence in self._unseen else replace(HAND, time_s=frame.time_s)

    def read(self, frame: Frame, hand: HandSample | None) -> Mapping[str, HoleView]:
        del frame, hand
        return {}

    def detect(self, segment: Segment, holes: Mapping[str, HoleView]) -> Action:
        del holes
        self.segments.append(segment)
        return Action("idle", 1.0)


def segments(sequences: Sequence[int], unseen: Sequence[int] = ()) -> list[Segment]:
    """What is asked about when frames of these numbers come."""
    seen = Everything(unseen)
    chain = DetectorChain(BENCH, PRODUCT, seen, seen, seen)
    image = np.full((BENCH.overhead.height_px, BENCH.overhead.width_px, 3), 90, np.uint8)
    for sequence in sequences:
        chain.watch(Frame("overhead", sequence, sequence / 15, image, BENCH.overhead.mount.pose))
    return seen.segments


def test_a_segment_spans_its_time_where_frames_were_lost() -> None:
    segment = segments([0, 1, 4, 5])[-1]
    assert [hand is not None for hand in segment.hands] == [True, True, False, False, True, True]
    assert [frame.sequence for frame in segment.frames] == [0, 1, 1, 1, 4, 5]


def test_after_a_long_gap_nothing_of_before_counts() -> None:
    segment = segments([0, 1, 1000])[-1]
    assert [hand is not None for hand in segment.hands] == [False] * (SEGMENT_FRAMES - 1) + [True]


def test_frames_that_are_numbered_anew_are_taken_as_they_come() -> None:
    assert len(segments([7, 8, 0, 1])[-1].hands) == 4


def test_a_segment_knows_where_the_hand_was_last_seen_before_it() -> None:
    found = segments(range(200), unseen=range(60, 150))
    assert found[0].before is None
    assert found[SEGMENT_FRAMES - 1].before is None
    for number in (SEGMENT_FRAMES, 70, 103, 104, 149, 160, 199):
        before = found[number].before
        first = number - SEGMENT_FRAMES + 1
        assert before is not None
        assert before.time_s == (first - 1 if first - 1 < 60 or first - 1 >= 150 else 59) / 15
    across = segments([0, 1, 50])[-1]
    assert across.before is not None
    assert across.before.time_s == 1 / 15
