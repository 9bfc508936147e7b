"""A part that falls from the hand into its hole was placed, though the hand only seemed to pass."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from bracket_cell.learned.actions.hole_events import DroppedParts, Filled
from bracket_cell.learned.actions.settings import Classes
from bracket_ground.interfaces.perception import HandSample, HoleView
from tests.learned.actions.drawn import HOLES_M, PRODUCT

CLASSES = Classes.of(PRODUCT)
AT = PRODUCT.positions.index("p2")


def hand(off_m: float, held: str | None = None) -> HandSample:
    """A hand so far from p2."""
    x, y = HOLES_M[AT]
    return HandSample(0.0, (0, 0, 9, 9), (x + off_m, y), (x + off_m + 0.1, y), held_part=held)


def dropped(before: HandSample | None, now: HandSample | None, **view: Any) -> list[Filled]:
    """What is told after two frames, 0.5 s apart; by default p2 shows the part then."""
    parts = DroppedParts(CLASSES, HOLES_M)
    assert parts.update(1.0, before, {"p2": HoleView(None, 0.99, 1.0)}) == []
    shown = replace(HoleView("o1", 0.97, 1.5), **view)
    return parts.update(shown.seen_s, now, {"p2": shown})


def test_a_part_that_was_held_over_the_hole_and_stands_there_without_the_hand_fell() -> None:
    assert dropped(hand(0.01, "o1"), hand(0.06)) == [Filled(0, AT, 0.97)]


def test_nothing_fell_while_the_hand_is_there_or_where_nobody_knows_where_it_is() -> None:
    assert dropped(hand(0.01, "o1"), hand(0.02)) == []
    assert dropped(hand(0.01, "o1"), hand(0.03, "o1")) == []
    assert dropped(hand(0.01, "o1"), None) == []


def test_what_the_hand_did_not_hold_over_the_hole_just_before_did_not_fall_from_it() -> None:
    assert dropped(hand(0.08, "o1"), hand(0.2)) == []
    assert dropped(hand(0.01), hand(0.06)) == []
    assert dropped(hand(0.01, "o2"), hand(0.06)) == []
    assert dropped(None, hand(0.06)) == []
    assert dropped(hand(0.01, "o1"), hand(0.06), seen_s=3.0) == []


def test_a_part_that_leans_or_is_doubtful_or_was_seen_before_does_not_stand_there_yet() -> None:
    assert dropped(hand(0.01, "o1"), hand(0.06), upright=False) == []
    assert dropped(hand(0.01, "o1"), hand(0.06), confidence=0.8) == []
    parts = DroppedParts(CLASSES, HOLES_M)
    parts.update(1.0, hand(0.01, "o1"), {})
    assert parts.update(1.5, hand(0.06), {"p2": HoleView("o1", 0.97, 1.2)}) == []
    assert parts.update(1.5, hand(0.06), {}) == []
