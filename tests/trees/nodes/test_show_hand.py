"""A shift begins with a hand that is shown: it proves that the detector can see one."""

from __future__ import annotations

from typing import Any

from bracket_cell.trees.nodes.people import ShowHand
from btxml.engine.status import Status
from btxml.testing import alone
from tests.trees.nodes.rig import hand_at, see, services


def test_it_waits_and_asks_until_a_hand_was_seen_and_remembers_it() -> None:
    to = services()
    node: Any = alone(ShowHand("show"), to)
    see(to, 0.0)
    assert node.execute() is Status.RUNNING
    assert "hand" not in to.now.display.message
    see(to, 1.5)
    assert node.execute() is Status.RUNNING
    assert to.now.display.message == "show your hand to the overhead camera"
    see(to, 2.0, hand=hand_at(0.7, 0.1))
    assert node.execute() is Status.SUCCESS
    see(to, 3.0)
    assert node.execute() is Status.SUCCESS


def test_it_fails_when_nobody_shows_one_in_time() -> None:
    to = services()
    node: Any = alone(ShowHand("show"), to, wait_s=5.0)
    see(to, 0.0)
    assert node.execute() is Status.RUNNING
    see(to, 5.1)
    assert node.execute() is Status.FAILURE
    assert "no hand was seen" in node.feedback_message
