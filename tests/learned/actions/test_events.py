"""Posteriors become placements that are told once, and one steady action."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from cell.configuration import load_configuration, load_product
from learned.actions.classes import Classes
from learned.actions.events import EventSettings, Floats, Placement, PlacementEvents, SteadyKind

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


def told(stream: Iterable[tuple[Floats, float]]) -> list[Placement]:
    """Placements that a stream of posteriors and "opened" gives, a frame each."""
    events = PlacementEvents(CLASSES, EventSettings())
    found = [events.update(index * FRAME_S, *frame) for index, frame in enumerate(stream)]
    return [one for one in found if one is not None]


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


def test_a_placement_is_told_once_soon_after_the_fingers_open() -> None:
    found = told(AWAY * 20 + placing() + AWAY * 20)
    assert [(one.part, one.position) for one in found] == [(0, 1)]
    assert 28 * FRAME_S <= found[0].time_s <= 32 * FRAME_S


def test_carrying_and_hesitating_over_a_hole_are_no_placement() -> None:
    assert told(AWAY * 5 + placing(opened=0) + AWAY * 20) == []


def test_a_flicker_of_one_frame_is_no_placement() -> None:
    assert told(AWAY * 5 + placing(frames=0, opened=1) + AWAY * 20) == []


def test_the_part_is_that_of_the_whole_movement_not_of_its_last_frame() -> None:
    stream = placing(frames=8, opened=2) + placing(frames=0, opened=3, o2_at_p2=0.9)
    assert [one.part for one in told(AWAY + stream + AWAY * 9)] == [0]


def test_a_second_placement_at_the_same_hole_counts_after_a_while() -> None:
    assert len(told(placing() + AWAY * 20 + placing() + AWAY * 20)) == 2
    assert len(told(placing() + AWAY * 5 + placing() + AWAY * 20)) == 1


def test_two_holes_one_after_the_other_are_two_placements() -> None:
    found = told(placing() + AWAY * 3 + placing(o3_at_p4=0.8) + AWAY * 10)
    assert [(one.part, one.position) for one in found] == [(0, 1), (2, 3)]


def test_a_screw_goes_on_through_doubtful_frames() -> None:
    kind = SteadyKind(CLASSES, EventSettings())
    stream = [posterior(screw=0.9)] * 5 + [posterior(screw=0.3)] + [posterior(screw=0.9)] * 5
    assert {CLASSES.names[kind.update(frame)[0]] for frame in stream} == {"screw"}
    assert CLASSES.names[[kind.update(posterior()) for _ in range(5)][-1][0]] == "transit"
