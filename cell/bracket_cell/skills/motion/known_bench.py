"""What separation knows of hands: samples whose numbers are finite, fresh and on the bench. No other can be made.

A sample that is refused never counts as no hand: the distance to it is unknown, and an unknown distance holds the arm.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, get_args

import numpy as np

from bracket_ground.errors import CellError
from bracket_ground.files.words.message import Message
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.perception import BenchView, Edge, HandSample
from bracket_ground.interfaces.pose import Array


@dataclass(frozen=True)
class PlausibleLimits:
    """Which samples of a hand can be true. Origin: bodies (DIN 33402-2) and a camera with 15 Hz.

    Attributes:
        stale_s: [s] age of a sample that counts: three frames are missing.
        future_s: [s] by which stamps of different clocks may differ: less than a frame.
        hand_m: [m] from palm to fingertips: a long hand is 0.21 m (DIN 33402-2); the rest is the error of a tracker
            without a card.
        palm_m: [m] between palms that count as one hand: half the breadth of a hand.
        box_m: [m] hand, held part and forearm in an image.
        low_m: [m] height of a hand that lies on the table, by a tracker without a card.
        speed_m_s: [m/s] of a track that changes to a hand at the other end of the view within a frame; no hand is
            faster.
        acceleration_m_s2: [m/s^2] of such a track.
    """

    stale_s: float = 0.35
    future_s: float = 0.05
    hand_m: float = 0.35
    palm_m: float = 0.05
    box_m: float = 0.8
    low_m: float = -0.05
    speed_m_s: float = 20.0
    acceleration_m_s2: float = 1000.0


PLAUSIBLE = PlausibleLimits()


EDGES: tuple[Edge, ...] = get_args(Edge)
TEXTS = ("health", "unseen", "unexplained", "hand_unknown", "depth_missing")

Range = tuple[Array, Array]
ALWAYS = ("fingertips_m", "palm_m", "box_px", "confidence")  # what every tracker tells
STAMPS: Range = (np.array(-1e12), np.array(1e12))  # [s] of any clock


class Implausible(CellError):
    """Hands as no sound tracker tells them; the text says which, and why."""


class ViewRange:
    """What a tracker of the overhead camera can tell of hands.

    Attributes:
        ranges: least and greatest numbers of a `HandSample`, by field.
    """

    def __init__(self, bench: Bench) -> None:
        camera, pose = bench.overhead.model, bench.overhead.mount.pose
        size = (float(camera.width_px), float(camera.height_px))
        corners_px = np.array([(column, row) for column in (0.0, size[0]) for row in (0.0, size[1])])
        corners_m = camera.onto_plane(pose, corners_px, 0.0)[:, :2]
        self._focal_px, self._eye_m = camera.focal_px, pose.position_m[2]
        place = corners_m.min(axis=0) - PLAUSIBLE.hand_m, corners_m.max(axis=0) + PLAUSIBLE.hand_m
        height = _range(PLAUSIBLE.low_m, self._eye_m)
        self.ranges: Mapping[str, Range] = {
            **dict.fromkeys(("fingertips_m", "palm_m", "thumb_m", "index_m", "held_m"), place),
            **dict.fromkeys(("height_m", "fingertips_height_m"), height),
            "velocity_m_s": _range([-PLAUSIBLE.speed_m_s] * 2, [PLAUSIBLE.speed_m_s] * 2),
            "acceleration_m_s2": _range([-PLAUSIBLE.acceleration_m_s2] * 2, [PLAUSIBLE.acceleration_m_s2] * 2),
            "box_px": _range([0.0] * 4, [*size, *size]),
            "forearm_rad": _range(-2 * math.pi, 2 * math.pi),
            "confidence": _range(0.0, 1.0),
            "deviation_m": _range([0.0] * 3, [1.0] * 3),
        }

    def doubt(self, view: BenchView, now_s: float) -> str:
        """Why the hands of a view cannot be believed, in words; empty where they can."""
        if not all(isinstance(getattr(view, name), str) for name in TEXTS) or not _within(view.time_s, *STAMPS):
            return "the view of the bench is not complete: it lacks its time or words"
        if not all(edge in EDGES for edge in view.left_by):
            return Message("a hand left by an edge that does not exist: {edges}", edges=f"{view.left_by!r:.60}")
        if not all(_within(hole.seen_s, *STAMPS) for hole in view.holes.values()):
            return "a hole was seen at a time that is no number"
        return next((words for hand in view.hands if (words := self._doubt(hand, view.time_s, now_s))), "")

    def _doubt(self, hand: Any, view_s: float, now_s: float) -> str:
        if not isinstance(hand, HandSample):
            return Message("a hand is not plausible: it is {told}", told=f"{hand!r:.60}")
        for name, (least, most) in self.ranges.items():
            point = getattr(hand, name)
            if not _within(point, least, most) and (point is not None or name in ALWAYS):
                return Message("a hand is not plausible: {name} is {told}", name=name, told=f"{point!r:.60}")
        if not math.dist(hand.palm_m, hand.fingertips_m) <= PLAUSIBLE.hand_m:
            return Message("a hand is not plausible: {name} is {told}", name="palm_m", told=f"{hand.palm_m!r:.60}")
        left, top, right, bottom = hand.box_px
        most_px = (
            self._focal_px * PLAUSIBLE.box_m / max(self._eye_m - max(hand.height_m or 0.0, 0.0), PLAUSIBLE.box_m / 8)
        )
        if not (0 < right - left <= most_px and 0 < bottom - top <= most_px):
            return Message("a hand is not plausible: {name} is {told}", name="box_px", told=f"{hand.box_px!r:.60}")
        if not _within(hand.time_s, *STAMPS) or not hand.time_s <= view_s + PLAUSIBLE.future_s:
            return "a hand is stamped with a time to come"
        if not now_s - hand.time_s <= max(PLAUSIBLE.stale_s, now_s - view_s + PLAUSIBLE.future_s):
            return Message("a hand was seen {age_s} s ago", age_s=f"{now_s - hand.time_s:.1f}")
        return ""


class KnownBench:
    """Hands in view, and edges that others may be behind, as far as separation may rely on them.

    Attributes:
        hands: in view.
        left_by: see `BenchView`.
        age_s: since the frame of the view was exposed.

    Raises:
        Implausible: a number of the view is not finite, not fresh, or not of this bench.
    """

    def __init__(self, view_range: ViewRange, view: BenchView, now_s: float) -> None:
        if words := view_range.doubt(view, now_s):
            raise Implausible(words)
        self.hands, self.left_by, self._now_s = view.hands, view.left_by, now_s
        self.age_s = max(0.0, now_s - view.time_s)

    def age_of_s(self, hand: HandSample) -> float:
        """Since it was seen: a tracker may answer from an earlier frame than that of the view."""
        return max(self.age_s, self._now_s - hand.time_s)

    @property
    def count(self) -> int:
        """How many hands are in view for certain: palms at one place are one hand that is told twice."""
        apart: list[HandSample] = []
        for hand in self.hands:
            if all(math.dist(hand.palm_m, other.palm_m) >= PLAUSIBLE.palm_m for other in apart):
                apart.append(hand)
        return len(apart)


def _range(least: float | list[float], most: float | list[float]) -> Range:
    return np.array(least), np.array(most)


def _within(values: Any, least: Array, most: Array) -> bool:
    """Whether these are so many numbers, each within its range; what is no number is not."""
    try:
        numbers = np.array(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        return False
    return numbers.shape == least.shape and bool(((numbers >= least) & (numbers <= most)).all())
