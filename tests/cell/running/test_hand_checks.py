"""Parts do not come and go by themselves: where no hand was seen, its detector may be blind."""

from __future__ import annotations

from dataclasses import replace

from bracket_cell.running.hand_checks import HandMemory
from bracket_ground.interfaces.observation import ObjectStatus, Observation
from bracket_ground.interfaces.perception import Action, BenchView, HandSample, HoleView
from tests.cell.running.test_supervisor import hand_at, sound

FRAME_S = 1 / 15
PLACED = 15  # the frame in which the part is seen first


def told(hand: set[int] = frozenset(), gripper: set[int] = frozenset(), filled: set[int] | None = None) -> list[str]:  # type: ignore[assignment]
    """What is said in each of 60 frames.

    Args:
        hand, gripper: frames in which a hand is seen, and the gripper holds something.
        filled: frames in which there is a part in the hole; from PLACED on by default.
    """
    memory, words = HandMemory(), []
    full = set(range(PLACED, 60)) if filled is None else filled
    for number in range(60):
        memory.see(seen(number, hand_at(0.7, 0.1) if number in hand else None, number in gripper, number in full))
        words.append(memory.blind)
    return words


def seen(number: int, hand: HandSample | None, holds: bool, full: bool, acknowledged: bool = False) -> Observation:
    now_s = number * FRAME_S
    hole = HoleView("o1" if full else None, 1.0, now_s)
    view = BenchView(number, now_s, hand, {"p1": hole}, Action("idle", 1.0))
    one = sound(number)
    status = ObjectStatus.CONTACT_CLOSING if holds else ObjectStatus.AT_POSITION
    gripper = replace(one.gripper, object_status=status)
    return replace(one, time_s=now_s, bench=view, gripper=gripper, acknowledged=acknowledged)


def test_a_part_that_came_without_a_hand_is_told_after_a_second() -> None:
    words = told()
    assert not any(words[: PLACED + 15])
    assert all("p1" in word for word in words[PLACED + 16 :])


def test_a_hand_that_was_seen_a_moment_before_or_after_has_placed_it() -> None:
    assert not any(told(hand={PLACED - 8}))
    assert not any(told(hand={PLACED + 10}))
    assert any(told(hand={0}, filled=set(range(40, 60))) or told(hand={0}))


def test_what_the_gripper_held_it_has_placed() -> None:
    assert not any(told(gripper=set(range(PLACED - 3))))


def test_a_hole_that_was_misread_for_a_moment_is_no_part() -> None:
    assert not any(told(filled={20, 21, 22}))


def test_a_part_that_went_is_told_too() -> None:
    assert any(told(filled=set(range(20))))


def test_it_lasts_until_somebody_acknowledges_it_or_a_hand_is_seen() -> None:
    for hand, acknowledged in ((None, True), (hand_at(0.7, 0.1), False)):
        memory = HandMemory()
        for number in range(60):
            memory.see(seen(number, None, False, number >= PLACED))
        assert memory.blind
        memory.see(seen(60, hand, False, True, acknowledged))
        assert not memory.blind


def test_a_hand_that_is_gone_must_have_left_by_an_edge() -> None:
    """What a detector no longer answers is not what is no longer there."""
    memory, held = HandMemory(), []
    for number, told in enumerate(("hand", "", "", "left", "", "hand", "", "unknown")):
        one = seen(number, hand_at(0.7, 0.1) if told == "hand" else None, False, False)
        assert one.bench is not None
        unknown = "it vanished inside the view" * (told == "unknown")
        view = replace(one.bench, left_by=("left",) if told == "left" else (), hand_unknown=unknown)
        memory.see(replace(one, bench=view))
        held.append(memory.vanished)
    assert held == [False, True, True, False, False, False, True, False]
