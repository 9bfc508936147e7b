"""Names what the hand does from its track and from what changed in the holes (detector(I, s) of Alg. 1)."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from bracket_cell.learned.classical.settings import PerceptionSettings
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.perception import Action, HandSample, HoleView, Segment
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.product import Product

SCREW_WINDOW_S = 1.0
SCREW_SWING_M = 0.006  # least way between two turning points of a coordinate
SCREW_LARGEST_M = 0.040
SCREW_TURNS = 3  # turning points of both coordinates together
SCREW_KEEPS_S = 0.4  # a screw action goes on this long after the last sign of it
CARRY_WINDOW_S = 1.5
REST_WINDOW_S, REST_M = 0.4, 0.06  # a hand with nothing at its fingers rests: still for so long, so close to its place
LONG_REST_WINDOW_S, LONG_REST_M = 1.5, 0.12  # so does any hand that is still for longer than it takes to grasp a part
REST_RATE_HZ = 10.0  # a hand that is seen less often is not judged
BEFORE_S = 0.5  # a hole is looked at this long before it is covered, so that frames overlap


@dataclass(frozen=True)
class _Placement:
    """An assembly whose hole was seen filled."""

    part: str
    position: str
    seen_s: float
    confidence: float


class ClassicalActionDetector:
    """Watches holes change and hands oscillate (ActionDetector); segments must come in order."""

    def __init__(self, bench: Bench, product: Product, settings: PerceptionSettings) -> None:
        self._settings = settings
        bracket = bench.bracket.pose
        holes = np.array([[*xy, 0.0] for xy in product.bracket.holes_m.values()])
        self._names = product.positions
        self._holes_m: Array = bracket.transform(holes)[:, :2]
        self._rest_m = np.array(bench.hand_rest_m[:2])
        self._known: dict[str, HoleView] = {}
        self._visits_s: dict[str, float] = {}
        self._placements: deque[_Placement] = deque()
        self._reported_s: float | None = None
        self._screw_s = -np.inf

    def detect(self, segment: Segment, holes: Mapping[str, HoleView]) -> Action:
        """The action that the segment shows; `holes` is the occupancy at its end."""
        now_s = segment.frames[-1].time_s
        hands = [hand for hand in segment.hands if hand is not None]
        at_hole = self._hole_near(segment.hands[-1])
        if at_hole is not None:
            self._visits_s[at_hole] = now_s
        self._note_placements(holes)
        if (placed := self._finished(now_s)) is not None:
            return placed
        if at_hole is not None and (working := self._working(at_hole, hands, holes, now_s)) is not None:
            return working
        if segment.hands[-1] is None or self._resting(hands, now_s):
            return Action("idle", 0.9)
        return Action("transit", 0.8)

    def _hole_near(self, hand: HandSample | None) -> str | None:
        """The hole that the fingertips work at."""
        if hand is None:
            return None
        distances = np.linalg.norm(self._holes_m - np.array(hand.fingertips_m), axis=1)
        nearest = int(distances.argmin())
        return self._names[nearest] if distances[nearest] < self._settings.at_hole_m else None

    def _note_placements(self, holes: Mapping[str, HoleView]) -> None:
        """A part that stands where none stood, and where the hand was meanwhile, was placed by the hand."""
        for position, view in holes.items():
            before = self._known.get(position)
            self._known[position] = view
            if before is None or view.part is None or not view.upright:
                continue
            new = before.part != view.part or not before.upright
            visited = self._visits_s.get(position, -np.inf) > before.seen_s - BEFORE_S
            if new and visited:
                self._placements.append(_Placement(view.part, position, view.seen_s, view.confidence))

    def _finished(self, now_s: float) -> Action | None:
        """The oldest finished assembly that was not yet reported for long enough."""
        if not self._placements:
            return None
        if self._reported_s is None:
            self._reported_s = now_s
        if now_s - self._reported_s > self._settings.report_s:
            self._placements.popleft()
            self._reported_s = None
            return self._finished(now_s)
        placed = self._placements[0]
        return Action("assembly", placed.confidence, placed.part, placed.position, finished=True)

    def _working(
        self, position: str, hands: list[HandSample], holes: Mapping[str, HoleView], now_s: float
    ) -> Action | None:
        """Screwing a part that stands in the hole, or bringing one to it."""
        view = holes.get(position)
        if view is None:
            return None
        if view.part is not None:
            if self._oscillates(position, hands, now_s):
                self._screw_s = now_s
            if now_s - self._screw_s < SCREW_KEEPS_S:
                return Action("screw", 0.9)
            return None
        held = Counter(hand.held_part for hand in hands if now_s - hand.time_s < CARRY_WINDOW_S and hand.held_part)
        if not held:
            return None
        part, votes = held.most_common(1)[0]
        return Action("assembly", votes / held.total(), part, position)

    def _oscillates(self, position: str, hands: list[HandSample], now_s: float) -> bool:
        """Fingertips that turn back several times within a second, close to one hole."""
        recent = [hand for hand in hands if now_s - hand.time_s < SCREW_WINDOW_S]
        recent = [hand for hand in recent if self._hole_near(hand) == position]
        if len(recent) < 5:
            return False
        tips = np.array([hand.fingertips_m for hand in recent])
        if float(np.ptp(tips, axis=0).max()) > SCREW_LARGEST_M:
            return False
        return sum(turning_points(column, SCREW_SWING_M) for column in tips.T) >= SCREW_TURNS

    def _resting(self, hands: list[HandSample], now_s: float) -> bool:
        """Palm at its resting place, fingertips still.

        A part that shows at the fingers may lie in a bin under them, and where the palm is seen depends on how high
        it is: after a longer while neither counts.
        """
        if hands[-1].held_part is None and self._still(hands, now_s, REST_WINDOW_S, REST_M):
            return True
        return self._still(hands, now_s, LONG_REST_WINDOW_S, LONG_REST_M)

    def _still(self, hands: list[HandSample], now_s: float, window_s: float, reach_m: float) -> bool:
        """Near the resting place for most of a while; medians, for the outline of a hand trembles by a pixel."""
        recent = [hand for hand in hands if now_s - hand.time_s < window_s]
        if len(recent) < round(window_s * REST_RATE_HZ):
            return False
        palms = np.array([hand.palm_m for hand in recent])
        if float(np.linalg.norm(np.median(palms, axis=0) - self._rest_m)) > reach_m:
            return False
        tips = np.array([hand.fingertips_m for hand in recent])
        half = len(tips) // 2
        moved = np.median(tips[half:], axis=0) - np.median(tips[:half], axis=0)
        return float(np.linalg.norm(moved)) < self._settings.still_m


def turning_points(values: Array, swing: float) -> int:
    """How often a signal (n,) turns back, each time after a way of at least `swing`."""
    turns, direction = 0, 0
    low = high = float(values[0])
    for value in map(float, values[1:]):
        low, high = min(low, value), max(high, value)
        if direction >= 0 and high - value >= swing:
            turns += direction > 0
            direction, low, high = -1, value, value
        elif direction <= 0 and value - low >= swing:
            turns += direction < 0
            direction, low, high = 1, value, value
    return turns
