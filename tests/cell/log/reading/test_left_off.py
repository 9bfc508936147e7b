"""What a log tells of the work that it broke off in: the graph, the bracket's number, what hangs in the gripper."""

from __future__ import annotations

from typing import Any

import pytest

from cell.configuration import load_configuration, load_product
from cell.interfaces.errors import InputError
from cell.interfaces.left_off import LeftOff
from cell.log.reading.left_off import _after, read_left_off
from tests import ROOT

PRODUCT = load_product(load_configuration())
CASE = ROOT / "tests" / "cases" / "assembly-g0-seed5.mcap"
G0 = dict(PRODUCT.goal_placements("g0"))


def after(*notes: tuple[str, dict[str, Any]]) -> LeftOff:
    left = LeftOff()
    for topic, fields in notes:
        left = _after(left, topic, fields, PRODUCT)
    return left


def test_a_whole_assembly_is_known_from_its_log() -> None:
    left = read_left_off(CASE, PRODUCT)
    assert dict(left.placed) == G0
    assert left.held_part in PRODUCT.parts
    assert (left.bracket, left.ended) == (0, False)
    assert LeftOff.of(left.plain()) == left


def test_a_log_of_another_product_is_refused() -> None:
    with pytest.raises(InputError, match="this one is with 'another'"):
        read_left_off(CASE, PRODUCT.model_copy(update={"name": "another"}))


def test_edges_that_were_taken_back_and_brackets_that_ended_are_followed() -> None:
    first = ("bracket", {"number": 1, "edge": "begin"})
    put = ("belief", {"edge": ["o1", "p1"], "source": "action"})
    assert after(first, put).state.placed == {"p1": "o1"}
    assert after(first, put, ("belief", {"edge": [None, "p1"], "source": "seen hole"})).state.placed == {}
    ended = ("bracket", {"number": 1, "edge": "end", "finished": True, "placed": G0, "goal": "g0"})
    assert (after(first, put, ended).ended, after(first, put, ended).state.placed) == (True, {})
    second = after(first, put, ended, ("bracket", {"number": 2, "edge": "begin"}), ("belief", {"told": "g1"}))
    assert (second.bracket, second.ended, second.state.told_goal, second.state.placed) == (2, False, "g1", {})


def test_a_goal_that_was_learned_is_learned_again() -> None:
    ended = ("bracket", {"number": 1, "edge": "end", "finished": True, "placed": G0, "goal": "new1"})
    assert after(ended, ended).finished == (tuple(G0[position] for position in PRODUCT.positions),)


def test_a_resumed_bracket_keeps_what_was_known_of_it() -> None:
    begun = ("bracket", {"number": 2, "edge": "begin"})
    put = ("belief", {"edge": ["o1", "p1"], "source": "action"})
    left = after(begun, put, ("bracket", {"number": 2, "edge": "begin", "resumed": True}))
    assert (left.bracket, left.state.placed) == (2, {"p1": "o1"})
