"""What a depth image says of hands: how high palm and fingertips are, and whether it knows anything under them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bracket_cell.learned.classical.box_model import View
from bracket_cell.learned.hands.reading import Reading, over_table
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import HandSample
from bracket_ground.interfaces.pose import Array

PALM_PX, TIP_PX = 4, 2  # half the width of a window around a point
LEAST_KNOWN = 0.25  # of a window's pixels
UNDER_SKIN_M, UNDER_NAIL_M = 0.020, 0.008  # of the palm's middle and of a fingertip
BELIEVED_M, TIPS_BELIEVED_M = 0.20, 0.05  # what is farther from what is guessed is the robot, a head or the table
ERROR_M = 0.008  # standard deviation of a palm's height by depth


def heights_by_depth(frame: Frame, view: View, reading: Reading, guess_m: tuple[float, float]) -> tuple[float, float]:
    """Heights of palm and fingertips over the table; the guess where depth tells none, or tells of something else.

    Args:
        guess_m: both heights by the colours.
    """
    palm_m, tips_m = guess_m
    if frame.depth_mm is None:
        return guess_m
    seen = height_at(frame.depth_mm, view, reading.points_px["palm"], PALM_PX)
    if seen is None or not abs(seen - UNDER_SKIN_M - palm_m) <= BELIEVED_M:
        return guess_m
    palm = over_table(seen - UNDER_SKIN_M)
    tips = palm + tips_m - palm_m
    found = [height_at(frame.depth_mm, view, reading.points_px[name], TIP_PX) for name in ("thumb", "index")]
    below_m = [nail_m - UNDER_NAIL_M for nail_m in found if nail_m is not None]
    near = [height_m for height_m in below_m if abs(height_m - tips) < TIPS_BELIEVED_M]
    return palm, over_table(float(np.mean(near)) if near else tips)


def height_at(depth_mm: NDArray[np.uint16], view: View, pixel: Array, half_px: int) -> float | None:
    """Height over the table of what is seen around a pixel (column, row); None where too little is known."""
    column, row = (round(float(value)) for value in pixel)
    rows, columns = (slice(max(0, at - half_px), max(0, at + half_px + 1)) for at in (row, column))
    window = depth_mm[rows, columns]
    known = window[window > 0]
    if known.size <= LEAST_KNOWN * (2 * half_px + 1) ** 2:
        return None
    away_m = float(np.median(known)) / 1e3
    model = view.model
    in_camera = model.normalised(model.straightened(np.asarray(pixel, float)[np.newaxis])[0])
    ray = view.world_from_camera.rotation @ np.array([*in_camera, 1.0])
    height = float(view.world_from_camera.position_m[2] + away_m * ray[2])
    return height if math.isfinite(height) else None


MISSING_S = 0.5  # so long a hand is looked at in vain before anybody is told: one-eyed shadows and edges pass sooner
MISSING = "the depth camera knows no depth under the hand: its height is estimated from its size"


class DepthUnderHands:
    """Whether the depth images of the overhead camera know what is under the palms of hands."""

    def __init__(self, bench: Bench) -> None:
        self._setup, self._since_s = bench.overhead, math.inf

    def judge(self, frame: Frame, hands: Sequence[HandSample]) -> str:
        """What is missing, in words; empty while depths are there, or none are sent, or no hand is seen."""
        if frame.depth_mm is None or not hands or not self._blind(frame, frame.depth_mm, hands):
            self._since_s = math.inf
            return ""
        self._since_s = min(self._since_s, frame.time_s)
        return MISSING if frame.time_s - self._since_s >= MISSING_S else ""

    def _blind(self, frame: Frame, depth_mm: NDArray[np.uint16], hands: Sequence[HandSample]) -> bool:
        view = View.of(self._setup.model, frame)
        palms = view.pixels(np.array([[*hand.palm_m, hand.height_m or 0.0] for hand in hands]))
        return any(height_at(depth_mm, view, palm, PALM_PX) is None for palm in palms)
