"""What the supervisor looks for in the hand detector: parts do not come and go by themselves."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from bracket_ground.files.words.message import Message
from bracket_ground.interfaces.observation import Observation
from bracket_ground.interfaces.perception import BenchView, HoleView


@dataclass(frozen=True)
class HandLimits:
    """When a hand has moved a part. Origin: chosen.

    Attributes:
        beside_s: [s] before or after a part came or went in which a hand that is seen has moved it.
    """

    beside_s: float = 1.0


LIMITS = HandLimits()


@dataclass(frozen=True)
class _Change:
    """A part that came into a hole, or went.

    Attributes:
        after_s: when the hole was seen last as it was before.
        seen_s: when it was seen first as it is now.
    """

    after_s: float
    seen_s: float


@dataclass(eq=False)
class HandMemory:
    """What is known of hands and holes in earlier ticks.

    Attributes:
        blind: why the hand detector cannot be believed, in words, until somebody acknowledges it or a hand is seen.
        vanished: a hand was seen, and since then the views say neither where it is nor by which edge it left.
    """

    blind: str = ""
    vanished: bool = False
    _in_view: bool = field(default=False, init=False)  # or not told where else
    _sequence: int = field(default=-1, init=False)
    _hand_s: float = field(default=-math.inf, init=False)  # when a hand was seen last
    _held_s: float = field(default=-math.inf, init=False)  # and something between the fingers
    _holes: dict[str, HoleView] = field(default_factory=dict, init=False)
    _changes: dict[str, _Change] = field(default_factory=dict, init=False)

    def see(self, seen: Observation) -> None:
        """A tick begins."""
        if seen.gripper.holding or not seen.gripper.activated:
            self._held_s = seen.time_s
        if seen.acknowledged:
            self.blind = ""
            self._changes.clear()
        if seen.bench is not None and seen.bench.sequence != self._sequence:
            self._sequence = seen.bench.sequence
            self._look(seen.bench)

    def _look(self, view: BenchView) -> None:
        if view.hands:
            self._hand_s, self.blind = view.time_s, ""
        self._in_view = bool(view.hands) or (self._in_view and not view.left_by and not view.hand_unknown)
        self.vanished = self._in_view and not view.hands
        for place, hole in view.holes.items():
            before = self._holes.get(place)
            if before is not None and before.part != hole.part and hole.seen_s > before.seen_s:
                if place in self._changes:  # it was a mistake
                    del self._changes[place]
                else:
                    self._changes[place] = _Change(before.seen_s, hole.seen_s)
            self._holes[place] = hole
        for place, change in list(self._changes.items()):
            if max(self._hand_s, self._held_s) >= change.after_s - LIMITS.beside_s:
                del self._changes[place]
            elif self._holes[place].seen_s >= change.seen_s + LIMITS.beside_s:
                self.blind = Message(
                    "the part at {place} changed, but no hand was seen: the hand detector may be blind", place=place
                )
                del self._changes[place]
