"""Posteriors become placements that are told once, and one steady action."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping

import numpy as np
import pytest

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.learned.actions.events import EventSettings, Floats, Placement, PlacementEvents, SteadyKind
from bracket_cell.learned.actions.hole_events import Filled, FilledHoles, seen_unfilled
from bracket_cell.learned.actions.segments import posterior_of
from bracket_cell.learned.actions.settings import Classes
from bracket_ground.interfaces.perception import HoleView

PRODUCT = load_product(load_configuration())
CLASSES = Classes.of(PRODUCT)
FRAME_S = 1 / 15


def posterior(**shares: float) -> Floats:
    """Shares by class, as in o1_at_p2; the rest is transit."""
    found = np.zeros(len(CLASSES.names))
    for name, share in shares.items():
        found[CLASSES.names.index(name.replace("_", " "))] = share
    found[CLASSES.names.index("transit")] += 1.0 - found.sum()
    return found


def told(
    stream: Iterable[tuple[Floats, float]],
    filled: Mapping[int, Filled] | None = None,
    empty: Mapping[int, Collection[int]] | None = None,
    holds: Mapping[int, int] | None = None,
) -> list[Placement]:
    """Placements that a stream of posteriors and "opened" gives, a frame each; holes are filled in some of them.

    Args:
        empty: by frame, the positions that are seen to be empty.
        holds: by frame, the part that the hand is seen to hold.
    """
    events, holes, bare, held = PlacementEvents(CLASSES, EventSettings()), filled or {}, empty or {}, holds or {}
    found = [
        events.update(
            index * FRAME_S,
            *frame,
            [holes[index]] if index in holes else [],
            bare.get(index, ()),
            holds=held.get(index),
        )
        for index, frame in enumerate(stream)
    ]
    return [placement for placement in found if placement is not None]


def placing(frames: int = 8, opened: int = 5, **shares: float) -> list[tuple[Floats, float]]:
    """Fingers that come and go over a hole."""
    shares = shares or {"o1_at_p2": 0.9}
    return [(posterior(**shares), 0.02)] * frames + [(posterior(**shares), 0.97)] * opened


AWAY = [(posterior(), 0.5)]


def test_the_default_product_has_the_paper_s_18_classes() -> None:
    assert int(CLASSES.of_goals(PRODUCT).sum()) == 18
    for number, name in enumerate(CLASSES.names):
        action = CLASSES.action(number, 1.0)
        assert str(action) == name
        assert CLASSES.number(action.kind, action.part, action.position) == number


def test_a_placement_is_told_once_when_the_fingers_have_opened_and_the_hand_leaves() -> None:
    found = told(AWAY * 20 + placing(frames=8, opened=5) + AWAY * 20)
    assert [(placement.part, placement.position) for placement in found] == [(0, 1)]
    assert found[0].time_s == pytest.approx(33 * FRAME_S)


def test_fingers_that_search_a_hole_and_look_open_have_placed_nothing_until_they_leave() -> None:
    """A peg may search its hole for a second; told while it does, the placement came too early."""
    (found,) = told(AWAY + placing(frames=8, opened=24) + AWAY * 20)
    assert found.time_s == pytest.approx(33 * FRAME_S)
    assert told(AWAY + placing(frames=8, opened=12) + placing(frames=6, opened=0) + AWAY * 20) == []
    (found,) = told(AWAY + placing(frames=8, opened=60))
    assert found.time_s == pytest.approx(40 * FRAME_S)  # a hand that stays for two seconds has let go


def test_a_look_that_shows_the_part_after_the_fingers_opened_tells_it_though_the_hand_seems_to_stay() -> None:
    """A hand that turns to screwing at once is taken for one that is still placing."""
    stream = AWAY + placing(frames=8, opened=24)
    (found,) = told(stream, {14: Filled(0, 1, 0.98)})
    assert not found.shown
    assert found.time_s == pytest.approx(14 * FRAME_S)
    (found,) = told(stream + AWAY, {5: Filled(0, 1, 0.98)})  # it was carried over the hole
    assert found.time_s == pytest.approx(33 * FRAME_S)


def test_carrying_and_hesitating_over_a_hole_are_no_placement() -> None:
    assert told(AWAY * 5 + placing(opened=0) + AWAY * 20) == []


def test_a_flicker_of_one_frame_is_no_placement() -> None:
    assert told(AWAY * 5 + placing(frames=0, opened=1) + AWAY * 20) == []


def test_the_part_is_that_of_the_whole_movement_not_of_its_last_frame() -> None:
    stream = placing(frames=8, opened=2) + placing(frames=0, opened=3, o2_at_p2=0.9)
    assert [placement.part for placement in told(AWAY + stream + AWAY * 9)] == [0]


def test_a_second_placement_at_the_same_hole_counts_after_a_while() -> None:
    assert len(told(placing() + AWAY * 20 + placing() + AWAY * 20)) == 2
    assert len(told(placing() + AWAY * 5 + placing() + AWAY * 20)) == 1


def test_two_holes_one_after_the_other_are_two_placements() -> None:
    found = told(placing() + AWAY * 3 + placing(o3_at_p4=0.8) + AWAY * 10)
    assert [(placement.part, placement.position) for placement in found] == [(0, 1), (2, 3)]


def test_a_screw_goes_on_through_doubtful_frames() -> None:
    kind = SteadyKind(CLASSES, EventSettings())
    stream = [posterior(screw=0.9)] * 5 + [posterior(screw=0.3)] + [posterior(screw=0.9)] * 5
    assert {CLASSES.names[kind.update(frame)[0]] for frame in stream} == {"screw"}
    assert CLASSES.names[[kind.update(posterior()) for _ in range(5)][-1][0]] == "transit"


def test_a_hole_that_is_newly_filled_tells_a_placement_whose_opening_fingers_nobody_made_out() -> None:
    stream = AWAY + placing(frames=8, opened=0) + AWAY * 30
    (found,) = told(stream, {7: Filled(0, 1, 0.98)})
    assert found.time_s == pytest.approx(9 * FRAME_S)  # the hand turns to other things
    (found,) = told(stream, {12: Filled(0, 1, 0.98)})
    assert found.time_s == pytest.approx(12 * FRAME_S)
    assert (found.part, found.position, found.shown) == (0, 1, True)
    assert found.posterior[0] > 0.98
    assert told(stream) == []


def test_fingers_that_still_hold_what_stands_in_the_hole_have_a_while_to_open() -> None:
    """Else a part that is only regripped would be told too early, as a placement that was not made."""
    for held in (14, 30):
        (found,) = told(AWAY + placing(frames=held) + AWAY * 9, {9: Filled(0, 1, 0.98)})
        assert not found.shown
        assert found.time_s >= (held + 1) * FRAME_S
        (found,) = told(AWAY + placing(frames=held, opened=0) + AWAY, {9: Filled(0, 1, 0.98)})
        assert found.shown
        assert found.time_s == pytest.approx((held + 1) * FRAME_S)
    (found,) = told(AWAY + placing(frames=60, opened=0), {9: Filled(0, 1, 0.98)})
    assert found.shown
    assert found.time_s == pytest.approx(39 * FRAME_S)


def test_a_part_that_is_carried_over_the_hole_before_the_hand_seems_to_place_it_is_told_when_the_hand_leaves() -> None:
    stream = AWAY * 10 + placing(frames=20, opened=0) + AWAY * 20
    (found,) = told(stream, {7: Filled(0, 1, 0.98)})
    assert found.shown
    assert found.time_s == pytest.approx(30 * FRAME_S)
    assert told(stream, {7: Filled(0, 1, 0.98)}, dict.fromkeys(range(30, 51), (1,))) == []  # it was taken on


def test_a_doubtful_look_tells_a_placement_where_the_hand_has_no_doubt() -> None:
    sure, unsure = placing(frames=8, opened=0), placing(frames=8, opened=0, o1_at_p2=0.5, o2_at_p2=0.42)
    look = {9: Filled(0, 1, 0.7)}
    (found,) = told(AWAY + sure + AWAY * 30, look)
    assert (found.part, found.position, found.shown) == (0, 1, True)
    assert told(AWAY + unsure + AWAY * 30, look) == []
    assert len(told(AWAY + unsure + AWAY * 30, {9: Filled(0, 1, 0.95)})) == 1
    surer = look | {11: Filled(0, 1, 0.8), 20: Filled(0, 1, 0.98)}
    assert len(told(AWAY + sure + AWAY * 30, surer)) == 1  # looks at what was told already tell nothing new
    returns = AWAY + sure + AWAY * 30 + placing(frames=8, opened=0) + AWAY * 10
    assert len(told(returns, look | {45: Filled(0, 1, 0.98)})) == 1
    assert len(told(returns, look | {45: Filled(0, 1, 0.98)}, {30: [1]})) == 2  # taken out, and placed again


def test_where_hand_and_hole_name_different_parts_the_surer_one_counts() -> None:
    """Parts of bare steel look alike in the fingers; in the hole they show better."""
    doubtful, sure = placing(o1_at_p2=0.6, o2_at_p2=0.35), placing(o1_at_p2=0.97, o2_at_p2=0.01)
    (found,) = told(AWAY + doubtful + AWAY * 30, {9: Filled(1, 1, 0.95)})
    assert (found.part, found.shown) == (1, False)
    assert found.posterior[1] > 0.9
    (found,) = told(AWAY + sure + AWAY * 30, {9: Filled(1, 1, 0.8)})
    assert found.part == 0


def test_a_hand_over_a_hole_that_is_seen_to_be_empty_has_placed_nothing_there() -> None:
    stream = AWAY + placing(opened=8) + AWAY * 20
    assert told(stream, empty=dict.fromkeys(range(40), (1,))) == []
    assert len(told(stream, empty=dict.fromkeys(range(40), (0, 2, 3, 4, 5)))) == 1
    assert told(stream, empty=dict.fromkeys(range(17, 40), (1,))) == []  # the hand took it along
    (found,) = told(stream, empty=dict.fromkeys(range(13), (1,)))
    assert found.time_s == pytest.approx(17 * FRAME_S)


def test_a_hand_that_leaves_with_the_part_has_placed_nothing_though_the_hole_seems_to_show_it() -> None:
    """A part that is held over a hole for a second looks as if it stood there."""
    hesitating, shows = [(posterior(o1_at_p2=0.5), 0.05)] * 16, {8: Filled(0, 1, 0.99), 9: Filled(0, 1, 0.99)}
    assert len(told(hesitating + AWAY * 30, shows)) == 1
    assert told(hesitating + AWAY * 30, shows, holds=dict.fromkeys(range(60), 0)) == []
    assert len(told(hesitating + AWAY * 30, shows, holds=dict.fromkeys(range(60), 1))) == 1  # it holds another part
    (late,) = told(hesitating + AWAY * 30, shows, holds=dict.fromkeys(range(20), 0))  # so late is seen what it holds
    assert late.time_s == pytest.approx(20 * FRAME_S)
    # Fingers that open are surer than what the hand seems to hold: it may be what stands under them.
    assert len(told(placing() + AWAY * 30, holds=dict.fromkeys(range(60), 0))) == 1


def test_hand_and_hole_tell_a_placement_once() -> None:
    stream = AWAY + placing() + AWAY * 30
    for at in (7, 12, 20, 40):
        assert len(told(stream, {at: Filled(0, 1, 0.98)})) == 1
    returns = AWAY + placing() + AWAY * 20 + placing(frames=8, opened=0) + AWAY * 10
    assert len(told(returns, {40: Filled(0, 1, 0.98)})) == 1  # the arm hid the hole until then


def test_a_hole_that_the_robot_fills_or_that_shows_another_part_is_no_placement_of_the_person() -> None:
    assert told(AWAY * 30, {12: Filled(0, 1, 0.98)}) == []
    stream = AWAY + placing(frames=8, opened=0) + AWAY * 30
    assert told(stream, {12: Filled(1, 1, 0.98)}) == []
    assert told(stream, {12: Filled(0, 2, 0.98)}) == []
    assert told(stream, {38: Filled(0, 1, 0.98)}) == []  # long after the hand was there


def test_a_part_that_fell_into_a_hole_that_was_empty_is_told_by_the_hole_and_not_again_until_it_was_taken_out() -> None:
    events, fell = PlacementEvents(CLASSES, EventSettings()), Filled(0, 1, 0.98)
    away, over = (posterior(), 0.5), (posterior(o1_at_p2=0.9), 0.97)

    def at(time_s: float, hand: tuple[Floats, float], **told: Collection[Filled | int]) -> bool:
        return events.update(time_s, *hand, **told) is not None  # type: ignore[arg-type]

    assert not at(1.0, away, dropped=[fell])  # it was full before
    assert at(1.1, away, filled=[fell], dropped=[fell])
    pressed = [at(2.5 + 0.1 * index, over) for index in range(8)] + [at(3.4, away)]
    assert not any(pressed)
    assert not at(5.0, away, unfilled=[1])
    assert at(5.1, away, filled=[fell], dropped=[fell])
    swapped = Filled(1, 1, 0.98)
    assert at(8.0, away, filled=[swapped], dropped=[swapped])


def test_where_the_movement_leaves_the_part_in_doubt_the_hole_is_waited_for() -> None:
    stream = AWAY + placing(o1_at_p2=0.5, o2_at_p2=0.42) + AWAY * 30
    assert told(stream) == []
    (found,) = told(stream, {16: Filled(0, 1, 0.98)})
    assert found.part == 0
    assert found.posterior[0] > 0.9


def test_a_hole_is_newly_filled_when_new_looks_agree_after_it_was_empty_until_a_look_is_sure() -> None:
    def filled(*looks: tuple[str | None, float, float]) -> list[int]:
        """Numbers of the looks (part, confidence, time) that tell."""
        holes = FilledHoles(CLASSES, 2, 0.9)
        views = [{"p2": HoleView(part, confidence, seen_s)} for part, confidence, seen_s in looks]
        return [number for number, view in enumerate(views) for _ in holes.update(view)]

    empty = (None, 0.99, 0.0)
    assert filled(empty, ("o1", 0.95, 1.0), ("o1", 0.95, 2.0), ("o1", 0.95, 3.0)) == [2]
    assert filled(empty, ("o1", 0.95, 1.0), ("o1", 0.95, 1.0), ("o1", 0.95, 2.0)) == [3]  # the second is no new look
    assert filled(("o1", 0.95, 1.0), ("o1", 0.95, 2.0)) == []  # nobody knows since when
    assert filled(empty, ("o1", 0.95, 1.0), ("o2", 0.95, 2.0), ("o2", 0.95, 3.0)) == [3]
    assert filled(empty, ("o1", 0.95, 1.0), ("o1", 0.6, 2.0), ("o1", 0.95, 3.0), ("o1", 0.95, 4.0)) == [2, 3]
    corrected = ("o2", 0.95, 1.0), ("o2", 0.95, 2.0), ("o1", 0.7, 3.0), ("o1", 0.7, 4.0)
    assert filled(empty, *corrected) == [2, 4]
    again = ("o1", 0.95, 1.0), ("o1", 0.95, 2.0), (None, 0.99, 3.0), ("o1", 0.95, 4.0), ("o1", 0.95, 5.0)
    assert filled(empty, *again) == [2, 5]


def test_a_part_that_leans_or_lies_there_fills_no_hole_until_it_is_pressed_home() -> None:
    holes = FilledHoles(CLASSES, 2, 0.9)
    looks = [(None, True), *[("o1", False)] * 3, *[("o1", True)] * 2]
    views = [HoleView(part, 0.99, float(time_s), upright) for time_s, (part, upright) in enumerate(looks)]
    assert [number for number, view in enumerate(views) for _ in holes.update({"p2": view})] == [5]


def test_a_hole_that_was_full_all_along_is_not_newly_filled() -> None:
    """Who tries to take a part out and lets go of it again has placed nothing."""

    def full(*looks: tuple[str | None, bool, float], at_s: float) -> set[int]:
        """Positions that are full at a time after looks (part, upright, time) at p2."""
        holes = FilledHoles(CLASSES, 2, 0.9)
        for part, upright, seen_s in looks:
            list(holes.update({"p2": HoleView(part, 0.99, seen_s, upright)}))
        return set(holes.long_full(at_s))

    assert full(("o1", True, 1.0), at_s=4.0) == {1}  # also while it is covered
    assert full(("o1", True, 1.0), at_s=3.9) == set()
    assert full(("o1", True, 1.0), (None, True, 2.0), ("o1", True, 3.0), at_s=5.0) == set()
    assert full(("o1", True, 1.0), ("o1", False, 2.0), at_s=5.0) == set()  # it leans, and may be placed again
    stream, there = AWAY + placing() + AWAY * 20, dict.fromkeys(range(40), (1,))
    assert told(stream, {14: Filled(0, 1, 0.98)}, there) == []


def test_new_looks_show_that_a_hole_is_empty_or_that_its_part_leans() -> None:
    views = {
        "p1": HoleView(None, 0.99, 5.0),
        "p2": HoleView("o1", 0.99, 5.0),
        "p3": HoleView(None, 0.99, 4.0),
        "p4": HoleView("o1", 0.99, 5.0, upright=False),
        "p5": HoleView("o1", 0.99, 4.0, upright=False),
    }
    assert seen_unfilled(CLASSES, views, 5.1) == {0, 3}
    assert seen_unfilled(CLASSES, views, 6.0) == set()


def test_classes_are_as_likely_as_they_are_met_with_and_not_as_they_were_trained() -> None:
    found = posterior_of(np.zeros((2, len(CLASSES.names)), np.float32))
    assert found.sum(axis=1) == pytest.approx([1.0, 1.0])
    screw, transit, idle = found[0, -3:] / found[0, 0]
    assert (screw, transit, idle) == pytest.approx((1.0, 2.0, 1.65))
    doubtful = np.zeros(len(CLASSES.names), np.float32)
    doubtful[0], doubtful[-2] = 5.0, 4.5
    assert int(posterior_of(doubtful).argmax()) == len(CLASSES.names) - 2


def leaving(released: float, frames: int = 6) -> list[tuple[Floats, float]]:
    """The hand on its way from a hole, with fingers that seem open, or not."""
    return [(posterior(), released)] * frames


def test_fingers_that_are_seen_open_only_as_the_hand_leaves_have_opened_there() -> None:
    fast = [(posterior(o1_at_p2=0.5), 0.3)] * 8
    assert [(placement.part, placement.position) for placement in told(fast + leaving(0.95))] == [(0, 1)]
    assert told(fast + leaving(0.1)) == []  # it leaves with the part
    assert told(fast + leaving(0.95), holds=dict.fromkeys(range(8, 14), 0)) == []  # it is seen to hold it
    assert told([(posterior(o1_at_p2=0.5), 0.3)] * 2 + leaving(0.95)) == []  # it passed by
    assert told(fast + leaving(0.1, frames=8) + leaving(0.95)) == []  # they opened somewhere else


def test_a_hand_that_leaves_placed_one_part_in_the_hole_that_it_was_seen_at_most() -> None:
    between = [(posterior(o1_at_p2=0.35, o1_at_p3=0.5), 0.3)] * 10
    assert [(placement.part, placement.position) for placement in told(between + leaving(0.95))] == [(0, 2)]
