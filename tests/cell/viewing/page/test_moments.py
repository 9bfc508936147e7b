"""In each moment of a shift one sentence says what to do, and means holes and bins; nothing contradicts it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import pytest

from bracket_ground.files.words.catalogue import catalogue
from tests.cell.viewing.page.moments import MOMENTS, brought_to
from tests.cell.viewing.page.rig import PageRig
from tests.trees.nodes.rig import PRODUCT

SAYS = {
    "unknown": ("Place any part: I cannot tell yet which bracket this is", tuple(PRODUCT.positions), ()),
    "unsure": ("Place any part: this is bracket A or bracket C", ("p2", "p3", "p4", "p5", "p6"), ()),
    "sure": ("Place the gate valve at p2: I bring the globe valve to p4", ("p2",), ("o1",)),
    "brings": ("Wait: I put the globe valve into p4", ("p4",), ()),
    "waits": ("Take your hand away from p4: I wait with the globe valve", ("p4",), ()),
    "question": ("Say which one you build: bracket B, bracket A or a new one?", (), ()),
    "alarm": (
        "Take your hands off the arm. If all is well, press Acknowledge",
        (),
        (),
    ),
    "finished": ("Take the bracket out: it is finished", (), ()),
}


@pytest.fixture
def rig() -> Iterator[PageRig]:
    made = PageRig()
    yield made
    made.page.abandon()


def state_of(rig: PageRig, moment: str) -> dict[str, Any]:
    """What the page is told after the sentence has settled."""
    brought_to(rig, moment)
    for _ in range(20):
        rig.tick()
    rig.page._published_s = float("-inf")
    rig.tick()
    return {name: json.loads(value) for name, value in rig.page._server._state.items()}


@pytest.mark.parametrize("moment", MOMENTS)
def test_one_sentence_says_what_to_do_and_where(rig: PageRig, moment: str) -> None:
    told = state_of(rig, moment)["instruction"]
    words, holes, bins = SAYS[moment]
    instruction = rig.page._state.instructor.now()
    assert (instruction.words, tuple(told["holes"]), tuple(told["bins"])) == (words, holes, bins)
    assert catalogue("de")(instruction.words) != words


def test_what_is_not_certain_is_open_everywhere(rig: PageRig) -> None:
    told = state_of(rig, "unsure")
    assert {hole["status"] for name, hole in told["bracket"].items() if name != "p1"} == {"open"}
    assert told["bracket"]["p2"]["parts"] == ["o1", "o2"]
    assert told["robot"]["next"] is None


def test_what_the_robot_brings_nobody_else_is_asked_to_place(rig: PageRig) -> None:
    told = state_of(rig, "sure")
    assert told["bracket"]["p4"] == {"status": "robot", "parts": ["o2"], "who": "", "upright": True}
    assert told["bracket"]["p2"]["status"] == "you"
    assert "p4" not in told["instruction"]["holes"]


def test_brackets_done_are_kept_with_who_placed_what_and_their_order(rig: PageRig) -> None:
    told = state_of(rig, "sure")
    first, second, third = told["brackets"]
    assert (first["finished"], first["order"], first["robot"], first["person"]) == (True, "A17", 3, 3)
    assert second["placed"]["p2"] == [PRODUCT.goal_placements("g0")["p2"], "robot"]
    assert third["finished"] is None
    assert [(job["id"], job["done"], job["amount"]) for job in told["operator"]["jobs"]] == [("A17", 2, 3)]
