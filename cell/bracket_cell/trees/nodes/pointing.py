"""A hole that a hand points at: an answer without a button, read of tracked hands alone."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, field

import numpy as np

from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.perception import BenchView, HandSample
from bracket_ground.interfaces.product import Product

OVER_M = 0.03  # from hole to fingertips, as of hole_events
STAYS_M = 0.02  # what stays within this is still: the deviation of a hand that is tracked badly is 12 mm
APART_S = 0.3  # looks that lie farther apart are no single look
EMPTY_S = 10.0  # a hole that was seen empty so shortly before a hand covered it still is


@dataclass(eq=False)
class Pointing:
    """Watches for a hand that stays over an empty hole with nothing between its fingers.

    That no part is named there is not enough, as a tracker may not tell: their tips must be seen nearer to each other
    than any part is wide, or parts must have been named between fingers before.

    Args:
        dwell_s: how long it must stay; hands that hesitate over a hole stay up to 1.2 s. 0: nobody points.
    """

    product: Product
    bench: Bench
    dwell_s: float
    _sequence: int = field(default=-1, init=False)
    _at: tuple[str, HandSample] | None = field(default=None, init=False)  # and the first look at it
    _last_s: float = field(default=-math.inf, init=False)
    _names_held: bool = field(default=False, init=False)
    _empty_s: dict[str, float] = field(default_factory=dict, init=False)

    def at(self, view: BenchView | None, legal: Collection[str]) -> str | None:
        """The hole of `legal` that a hand has pointed at for long enough, with this look; else None."""
        if view is None or view.sequence == self._sequence or not self.dwell_s:
            return None
        self._sequence = view.sequence
        self._names_held |= any(hand.held_part is not None for hand in view.hands)
        self._empty_s |= {name: hole.seen_s for name, hole in view.holes.items() if hole.part is None}
        full = {name for name, hole in view.holes.items() if hole.part is not None}
        found = [(name, hand) for hand in view.hands if (name := self._over(hand)) is not None]
        if view.hand_unknown or len(found) != 1 or found[0][0] in full or found[0][0] not in legal:
            self._at = None
            return None
        [(name, hand)] = found
        if not self._goes_on(name, hand, view.time_s):
            self._at = (name, hand) if view.time_s - self._empty_s.get(name, -math.inf) <= EMPTY_S else None
        self._last_s = view.time_s
        return name if self._at is not None and view.time_s - self._at[1].time_s >= self.dwell_s else None

    def _goes_on(self, name: str, hand: HandSample, time_s: float) -> bool:
        """Whether this is the same hand at the same hole, which has stayed where it was."""
        if self._at is None or self._at[0] != name or time_s - self._last_s > APART_S:
            return False
        return math.dist(hand.fingertips_m, self._at[1].fingertips_m) <= STAYS_M

    def _over(self, hand: HandSample) -> str | None:
        """The hole that a hand is over, with nothing between its fingers."""
        if hand.held_part is not None or not (self._names_held or self._closed(hand)):
            return None
        holes = {name: np.array([*xy, 0.0]) for name, xy in self.product.bracket.holes_m.items()}
        on_bench = {name: self.bench.bracket.pose.transform(hole)[:2] for name, hole in holes.items()}
        away_m = {name: math.dist(hand.fingertips_m, at) for name, at in on_bench.items()}
        nearest = min(away_m, key=lambda name: away_m[name])
        return nearest if away_m[nearest] < OVER_M else None

    def _closed(self, hand: HandSample) -> bool:
        """Whether no part has room between the tips of thumb and index finger."""
        narrowest_m = min(part.size_m[1] for part in self.product.parts.values())
        tips = hand.thumb_m, hand.index_m
        return tips[0] is not None and tips[1] is not None and math.dist(tips[0], tips[1]) < narrowest_m
