"""Whether detectors' answers show a fault: values that nothing at a bench has, or answers that contradict one another.

As in `bracket_lab.evaluations.evidence`, tolerances are what a sound simulated cell never leaves.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from bracket_ground.interfaces.observation import Observation
from bracket_ground.interfaces.perception import BenchView, HandSample, HoleView, PartsView

FUTURE_S, SAMPLE_OLD_S, ANSWER_OLD_S = 0.02, 0.02, 0.35
REACH_M, LOW_M, HIGH_M, HAND_M = 2.5, -0.10, 1.2, 0.30  # from the world's origin; over the table; palm to tips
FASTEST_M_S, JUMP_M, SPEED_OFF_M_S, SPEED_UP_M_S2 = 3.0, 0.06, 1.0, 60.0


class AnswerEvidence:
    """Looks at each new answer."""

    def __init__(self) -> None:
        self._bench: BenchView | None = None
        self._parts: PartsView | None = None

    def found(self, seen: Observation) -> Iterator[str]:
        """What is wrong with the newest answers, in words."""
        bench, before, self._bench = seen.bench, self._bench, seen.bench
        parts, tray, self._parts = seen.parts, self._parts, seen.parts
        if bench is not None and bench is not before:
            yield from _of_stamps("bench", bench, before)
            for hand in bench.hands:
                yield from _of_hand(hand, bench.time_s)
            yield from _of_holes(bench.holes, bench.time_s)
            if not (bench.hands or bench.left_by or bench.hand_unknown):
                yield "no hand is seen, and none has left"
            if before is not None:
                yield from _of_change(bench, before)
        if parts is not None and parts is not tray:
            yield from _of_stamps("tray", parts, tray)
            if not -FUTURE_S <= seen.time_s - parts.time_s <= ANSWER_OLD_S:
                yield f"a new view of the tray is {seen.time_s - parts.time_s:.2f} s old"
            places = [value for detection in parts.detections for value in detection.world_from_part.position_m]
            if not all(abs(value) < REACH_M for value in places):
                yield "a part is nowhere near the bench"


def _of_stamps(name: str, view: BenchView | PartsView, before: BenchView | PartsView | None) -> Iterator[str]:
    if before is not None and not view.time_s > before.time_s:
        yield f"views of the {name} do not get newer"


def _of_hand(hand: HandSample, view_s: float) -> Iterator[str]:
    pairs = hand.palm_m, hand.fingertips_m, hand.velocity_m_s or (0.0, 0.0), hand.acceleration_m_s2 or (0.0, 0.0)
    most = REACH_M, REACH_M, FASTEST_M_S, SPEED_UP_M_S2
    if not all(math.hypot(*pair) <= limit for pair, limit in zip(pairs, most, strict=True)):
        yield "a hand is nowhere near the bench, or faster than hands are"
    elif not math.dist(hand.palm_m, hand.fingertips_m) <= HAND_M:
        yield "a hand is longer than hands are"
    if not all(LOW_M <= (height or 0.0) <= HIGH_M for height in (hand.height_m, hand.fingertips_height_m)):
        yield "a hand is below the table, or above the camera"
    if not abs(hand.time_s - view_s) <= SAMPLE_OLD_S:
        yield f"a hand is {view_s - hand.time_s:.2f} s older than the view that has it"


def _of_holes(holes: Mapping[str, HoleView], view_s: float) -> Iterator[str]:
    for place, hole in holes.items():
        if not 0 <= hole.confidence <= 1 or not hole.seen_s <= view_s + FUTURE_S:
            yield f"{place} is seen with {hole.confidence:.2f}, {view_s - hole.seen_s:.2f} s ago"


def _of_change(bench: BenchView, before: BenchView) -> Iterator[str]:
    """From one view to the next."""
    took_s = bench.time_s - before.time_s
    if not set(before.holes) <= set(bench.holes):
        yield "holes that were seen are forgotten"
    if bench.hand is None or before.hand is None or not 0 < took_s < 0.2:
        return
    moved = [now - then for now, then in zip(bench.hand.palm_m, before.hand.palm_m, strict=True)]
    if not math.hypot(*moved) <= JUMP_M + FASTEST_M_S * took_s:
        yield "a hand jumps"
