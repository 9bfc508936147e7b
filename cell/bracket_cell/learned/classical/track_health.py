"""Whether no hand in an image means that none is there."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from bracket_cell.learned.classical.bench_evidence import person_edge
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.perception import Edge, HandSample
from bracket_ground.interfaces.pose import Array


@dataclass(frozen=True)
class TrackLimits:
    """When no hand means that none is there. Origin: hands at 2.0 m/s (ISO 13855); the rest chosen.

    Attributes:
        edge_px: [px] from the image's edge at which a box touches it.
        leaves_s: [s] for which a hand that is no longer seen counts as moving on.
        unseen_px: [px] of a hand at the edge that may be too little to be found.
        hand_m_s: [m/s] of the fastest hand.
        hand_m: [m] of the highest hand.
    """

    edge_px: int = 6
    leaves_s: float = 0.2
    unseen_px: int = 40
    hand_m_s: float = 2.0
    hand_m: float = 0.4


TRACK = TrackLimits()


Point = tuple[float, float]


class TrackHealth:
    """Says whether no hand means that there is none, and how fast a hand moves.

    Attributes:
        left_by: edges by which the hand left the view, or may have; empty while one is seen. Before the first one, the
            person's: that no hand was seen so far does not mean that none is there.
    """

    def __init__(self, bench: Bench) -> None:
        camera = bench.overhead.model
        self._size = (camera.width_px, camera.height_px)
        self._fastest_px_s = TRACK.hand_m_s * camera.focal_px / (bench.overhead.mount.position_m[2] - TRACK.hand_m)
        self._seen: deque[tuple[float, HandSample]] = deque(maxlen=4)
        self._unknown = ""
        self.left_by: tuple[Edge, ...] = (person_edge(bench),)

    def unknown(self, time_s: float, hand: HandSample | None) -> str:
        """Why it is not known where the hand is; empty where it is seen, or left by the edge of the view."""
        if hand is not None:
            self._seen.append((time_s, hand))
            self._unknown, self.left_by = "", ()
        elif self._seen:
            self.left_by = self._edges(time_s)
            self._unknown = "" if self.left_by else "it vanished inside the view"
            self._seen.clear()
        return self._unknown

    @property
    def motion(self) -> tuple[Point | None, Point | None]:
        """Velocity and acceleration of the hand; see `motion_of`."""
        return motion_of([(time_s, np.array([hand.palm_m, hand.fingertips_m])) for time_s, hand in self._seen])

    def _edges(self, time_s: float) -> tuple[Edge, ...]:
        """By which edges the hand can have left: it touched them, or was about to, and could be out of view by now."""
        last_s, hand = self._seen[-1]
        box, gone_s = hand.box_px, time_s - last_s
        ahead_s = min(gone_s, TRACK.leaves_s)
        speeds = self._box_speeds()
        left, top, right, bottom = (value + speed * ahead_s for value, speed in zip(box, speeds, strict=True))
        width, height = self._size
        outer: dict[Edge, float] = {"left": left, "top": top, "right": width - right, "bottom": height - bottom}
        inner: dict[Edge, float] = {"left": box[2], "top": box[3], "right": width - box[0], "bottom": height - box[1]}
        most_px = self._fastest_px_s * gone_s + TRACK.unseen_px
        return tuple(edge for edge in outer if outer[edge] <= TRACK.edge_px and inner[edge] <= most_px)

    def _box_speeds(self) -> tuple[float, ...]:
        (from_s, start), (to_s, end) = self._seen[0], self._seen[-1]
        if to_s <= from_s:
            return (0.0, 0.0, 0.0, 0.0)
        return tuple((b - a) / (to_s - from_s) for a, b in zip(start.box_px, end.box_px, strict=True))


def motion_of(places: Sequence[tuple[float, Array]]) -> tuple[Point | None, Point | None]:
    """Mean velocity of the palm over all places, and what palm and fingertips share of their last acceleration.

    A hand that turns about its fingertips, as with a screwdriver, or bends its fingers, speeds up to go nowhere. None
    where the places are too few, or where their times do not increase.

    Args:
        places: palm and fingertips (2, 2), each with its time.
    """
    if len(places) < 2 or any(after[0] <= before[0] for before, after in pairwise(places)):
        return None, None
    velocity = _speed(places[0], places[-1])[0]
    if len(places) < 3:
        return _xy(velocity), None
    gained = _speed(places[-2], places[-1]) - _speed(places[-3], places[-2])
    least = gained[np.linalg.norm(gained, axis=1).argmin()]
    shared = least if (gained @ least >= 0).all() else np.zeros(2)
    return _xy(velocity), _xy(2 * shared / (places[-1][0] - places[-3][0]))


def _speed(before: tuple[float, Array], after: tuple[float, Array]) -> Array:
    speed: Array = (after[1] - before[1]) / (after[0] - before[0])
    return speed


def _xy(point: Array) -> Point:
    return float(point[0]), float(point[1])
