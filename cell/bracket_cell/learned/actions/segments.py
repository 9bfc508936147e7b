"""What networks see of a segment: the hand's track in the bracket's frame, and two windows around the fingertips."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bracket_cell.learned.actions.settings import KINDS
from bracket_cell.learned.inference.onnx_model import ModelCard
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.hand_window import (
    TIPS_HEIGHT_M,
    hand_window,
    last_at_hole,
    seen_frames,
    small_frame,
    window_px,
)
from bracket_ground.interfaces.perception import SEGMENT_FRAMES, ActionKind, HandSample, Segment
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.product import Product

SCALE_M = 0.2  # track coordinates are in this length
HEIGHTS_M, LEAST_M = 0.1, 0.02  # heights over the table, too, so much more of them: zero means unknown
CROP_PX = 64  # side of what networks see: the middle two thirds of a window
WINDOW_CROP = 2 / 3
TRACK_FEATURES = 9
LONG_S = 12.0  # a hand that was not seen for so long may be anywhere
TIPS, PALM, HEIGHT, OPENING = slice(0, 2), slice(2, 4), 4, 5  # columns of a track
UNKNOWN_HAND = (np.nan,) * 6

Images = NDArray[np.uint8]
Floats = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Inputs:
    """What a network is asked about one segment.

    Attributes:
        track: (TRACK_FEATURES, SEGMENT_FRAMES) fingertips x, y, palm x, y, whether it was seen, frames since a hole,
            height of the fingertips and how far they are apart, how long ago the hand was seen. Where it was not seen
            they tell of when it was; height and opening are 0 where the tracker does not tell them.
        crops: (2, CROP_PX, CROP_PX, 3) uint8: the hand now, and where it was last at a hole; black where there is none.
        at_hole: index in the segment of the second crop; None where the hand was at no hole.
    """

    track: Floats
    crops: Images
    at_hole: int | None


class SegmentReader:
    """Makes inputs of segments on one bench."""

    def __init__(self, bench: Bench, product: Product) -> None:
        self._bench = bench
        pose = bench.bracket.pose
        self._turn = pose.rotation[:2, :2]
        self._middle_m = np.array(pose.position_m[:2])
        self.holes_m = holes_on_bench(bench, product)
        self._side_px = window_px(bench.overhead)

    def read(self, segment: Segment) -> Inputs:
        """Inputs of the last SEGMENT_FRAMES frames; a shorter segment counts as if nothing was seen before."""
        missing = SEGMENT_FRAMES - len(segment.hands)
        hands: list[HandSample | None] = [*([None] * missing), *segment.hands]
        shape = points([segment.before, *hands])
        at_hole = last_at_hole(shape[1:, TIPS], self.holes_m)
        crops = np.zeros((2, CROP_PX, CROP_PX, 3), np.uint8)
        for crop, index in zip(crops, (SEGMENT_FRAMES - 1, at_hole), strict=True):
            hand = None if index is None else hands[index]
            if index is not None and hand is not None:
                crop[:] = middle(self._window(segment.frames[index - missing], hand))
        before_s = math.inf if segment.before is None else segment.frames[0].time_s - segment.before.time_s
        return Inputs(self.track(shape, before_s, at_hole), crops, at_hole)

    def frames(self, segment: Segment) -> Images:
        """Every third whole frame (k, 60, 80, 3), made small; a shorter segment counts as if it had stood still."""
        missing = SEGMENT_FRAMES - len(segment.frames)
        numbers = (max(0, index - missing) for index in seen_frames(SEGMENT_FRAMES - 1))
        return np.stack([small_frame(segment.frames[number].image) for number in numbers])

    def track(self, told_m: Array, before_s: float, at_hole: int | None) -> Floats:
        """Features (TRACK_FEATURES, n) of a track.

        Args:
            told_m: (1 + n, 6), see `points`: the hand as it was last seen before, and in each of n frames.
            before_s: for how long it had not been seen when the n frames began.
        """
        found = np.zeros((TRACK_FEATURES, len(told_m)), np.float32)
        seen = ~np.isnan(told_m[:, 0])
        ago_s = np.full(len(told_m), LONG_S)
        if seen.any():
            last = _last_seen(seen)
            filled = told_m[last]
            for row, columns in ((0, TIPS), (2, PALM)):
                found[row : row + 2] = (((filled[:, columns] - self._middle_m) @ self._turn) / SCALE_M).T
            for row, column in ((6, HEIGHT), (7, OPENING)):
                found[row] = np.nan_to_num((filled[:, column] + LEAST_M) / HEIGHTS_M)
            times_s = np.arange(-1, len(told_m) - 1) / self._bench.overhead.rate_hz
            times_s[0] = -before_s
            ago_s = np.where(last <= np.arange(len(last)), times_s - times_s[last], LONG_S)
        found[4] = seen
        found[5] = 1.0 if at_hole is None else (len(told_m) - 2 - at_hole) / (len(told_m) - 1)
        found[8] = np.minimum(ago_s, LONG_S) / LONG_S
        return found[:, 1:]

    def _window(self, frame: Frame, hand: HandSample) -> Images:
        """The window around the fingertips as the tracker has put them on the bench."""
        height_m = TIPS_HEIGHT_M if hand.fingertips_height_m is None else hand.fingertips_height_m
        place = np.array([[*hand.fingertips_m, height_m]])
        column, row = self._bench.overhead.model.project(frame.world_from_camera, place)[0]
        return hand_window(frame.image, (float(column), float(row)), self._side_px)


def holes_on_bench(bench: Bench, product: Product) -> Array:
    """(positions, 2) where the holes are, by the product's order."""
    holes = np.array([[*product.bracket.holes_m[position], 0.0] for position in product.positions])
    found: Array = bench.bracket.pose.transform(holes)[:, :2]
    return found


def points(hands: Sequence[HandSample | None]) -> Array:
    """A track (n, 6) in [m]: fingertips and palm on the bench, height of the fingertips, how far they are apart.

    NaN where no hand was seen, or where the tracker does not tell.
    """
    return np.array([UNKNOWN_HAND if hand is None else _point(hand) for hand in hands], float).reshape(-1, 6)


def _point(hand: HandSample) -> tuple[float, ...]:
    height_m = math.nan if hand.fingertips_height_m is None else hand.fingertips_height_m
    return (*hand.fingertips_m, *hand.palm_m, height_m, opening_m(hand.thumb_m, hand.index_m))


def opening_m(thumb_m: Sequence[float] | None, index_m: Sequence[float] | None) -> float:
    """How far the tips (x, y) of thumb and index finger are apart; not a number where that is not told."""
    return math.nan if thumb_m is None or index_m is None else math.dist(thumb_m, index_m)


def middle(window: Images, shift_px: tuple[int, int] = (0, 0)) -> Images:
    """What networks see of a window, (CROP_PX, CROP_PX, 3); resized where the camera's scale is another one.

    Args:
        shift_px: of the middle, as (down, right) in the window's pixels.
    """
    side = len(window)
    size = round(side * WINDOW_CROP)
    top, left = (int(np.clip((side - size) // 2 + shift, 0, side - size)) for shift in shift_px)
    crop = window[top : top + size, left : left + size]
    if size == CROP_PX:
        return crop
    import cv2

    return np.asarray(cv2.resize(crop, (CROP_PX, CROP_PX), interpolation=cv2.INTER_AREA), np.uint8)


def _last_seen(seen: NDArray[np.bool_]) -> NDArray[np.intp]:
    """(n,) for each sample the last seen one up to it; the first seen one before that."""
    order = np.where(seen, np.arange(len(seen)), -1)
    filled = np.maximum.accumulate(order)
    filled[filled < 0] = int(np.flatnonzero(seen)[0])
    return filled


FIRST_FEATURES = 6  # of cards that do not say how many


def known_features(card: ModelCard, track: NDArray[np.float32]) -> NDArray[np.float32]:
    """Of the features of tracks (n, features, frames) those that a network was trained with: old ones know fewer."""
    return track[:, : int(str(card.config.get("track_features", FIRST_FEATURES)))]


def posterior_of(logits: NDArray[np.float32]) -> NDArray[np.float64]:
    """Softmax over the last axis, the classes, corrected for how often they are met with (Saerens 2002)."""
    raised = np.exp(logits.astype(float) - logits.max(axis=-1, keepdims=True))
    raised[..., -len(KINDS) :] *= [MORE_OFTEN[kind] for kind in KINDS]
    found: NDArray[np.float64] = raised / raised.sum(axis=-1, keepdims=True)
    return found


# Training shows assemblies far more often than they are met with. These are half of the way back, in logarithms: all of
# it would hide assemblies of which little is seen. Chosen on validation recordings by physics.
MORE_OFTEN: dict[ActionKind, float] = {"screw": 1.0, "transit": 2.0, "idle": 1.65}
