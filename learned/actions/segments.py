"""What networks see of a segment: the hand's track in the bracket's frame, and two windows around the fingertips."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cell.interfaces.bench import Bench
from cell.interfaces.hand_window import TIPS_HEIGHT_M, hand_window, last_at_hole, window_px
from cell.interfaces.perception import SEGMENT_FRAMES, Frame, HandSample, Segment
from cell.interfaces.pose import Array
from cell.interfaces.product import Product

SCALE_M = 0.2  # track coordinates are told in this length
CROP_PX = 64  # side of what networks see: the middle two thirds of a window
WINDOW_CROP = 2 / 3
TRACK_FEATURES = 6

Images = NDArray[np.uint8]
Floats = NDArray[np.float32]


@dataclass(frozen=True)
class Inputs:
    """What a network is asked about one segment.

    Attributes:
        track: (TRACK_FEATURES, SEGMENT_FRAMES) fingertips x, y, palm x, y, whether it was seen, frames since a hole.
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
        tips, palms = points(hands)
        at_hole = last_at_hole(tips, self.holes_m)
        crops = np.zeros((2, CROP_PX, CROP_PX, 3), np.uint8)
        for crop, index in zip(crops, (SEGMENT_FRAMES - 1, at_hole), strict=True):
            hand = None if index is None else hands[index]
            if index is not None and hand is not None:
                crop[:] = middle(self._window(segment.frames[index - missing], hand))
        return Inputs(self.track(tips, palms, at_hole), crops, at_hole)

    def track(self, tips_m: Array, palms_m: Array, at_hole: int | None) -> Floats:
        """Features (TRACK_FEATURES, n) of fingertips and palms (n, 2) on the bench, NaN where no hand was seen."""
        seen = ~np.isnan(tips_m[:, 0])
        found = np.zeros((TRACK_FEATURES, len(tips_m)), np.float32)
        if seen.any():
            filled = _last_seen(seen)
            for row, places in ((0, tips_m), (2, palms_m)):
                found[row : row + 2] = (((places - self._middle_m) @ self._turn) / SCALE_M)[filled].T
        found[4] = seen
        found[5] = 1.0 if at_hole is None else (len(tips_m) - 1 - at_hole) / len(tips_m)
        return found

    def _window(self, frame: Frame, hand: HandSample) -> Images:
        """The window around the fingertips as the tracker has put them on the bench."""
        height_m = TIPS_HEIGHT_M if hand.height_m is None else hand.height_m
        place = np.array([[*hand.fingertips_m, height_m]])
        column, row = self._bench.overhead.model.project(frame.world_from_camera, place)[0]
        return hand_window(frame.image, (float(column), float(row)), self._side_px)


def holes_on_bench(bench: Bench, product: Product) -> Array:
    """(positions, 2) where the holes are, by the product's order."""
    holes = np.array([[*product.bracket.holes_m[position], 0.0] for position in product.positions])
    found: Array = bench.bracket.pose.transform(holes)[:, :2]
    return found


def points(hands: Sequence[HandSample | None]) -> tuple[Array, Array]:
    """Fingertips and palms (n, 2) in [m], NaN where no hand was seen."""
    nowhere = (np.nan, np.nan)
    tips = np.array([nowhere if hand is None else hand.fingertips_m for hand in hands], float).reshape(-1, 2)
    palms = np.array([nowhere if hand is None else hand.palm_m for hand in hands], float).reshape(-1, 2)
    return tips, palms


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
