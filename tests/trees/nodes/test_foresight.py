"""Where the part in the gripper will go, foreseen from the way of the hand."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from bracket_cell.learned.classical.foresight import foreseen
from bracket_cell.trees.guard import Verdict
from bracket_cell.trees.nodes.foresight import MoveBeside, PositionForeseen
from bracket_cell.trees.nodes.services import Services
from bracket_ground.interfaces.perception import Action, HandSample
from bracket_ground.interfaces.planning import AssemblyPlan, AssemblyState
from bracket_ground.interfaces.skill import Progress, SkillStatus
from btxml.engine.status import Status
from btxml.testing import alone
from tests.trees.nodes.rig import PRODUCT, SURE, ScriptedPlanner, hand_at, see, services
from tests.trees.nodes.test_ahead import hole_m

HOLES_M = {name: hole_m(name) for name in PRODUCT.positions}
ALIKE = dict.fromkeys(HOLES_M, 0.3)
OPEN = AssemblyPlan(SURE.goal_belief, {("o2", "p5"): 0.5, ("o2", "p6"): 0.5}, "o2", {"o2": ("p5", "p6"), "o1": ()})


def towards(hole: str, from_m: float, speed_m_s: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """Fingertips that come straight from the person."""
    x, y = hole_m(hole)
    return (x + from_m, y), (-speed_m_s, 0.0)


@pytest.mark.parametrize("hole", PRODUCT.positions)
def test_shares_are_probabilities_and_the_hole_ahead_has_the_most(hole: str) -> None:
    shares = foreseen(*towards(hole, 0.12, 0.4), HOLES_M, ALIKE)
    assert sum(shares.values()) == pytest.approx(1.0)
    assert max(shares, key=lambda name: shares[name]) == hole


def test_a_hand_that_comes_nearer_is_foreseen_more_surely_and_a_hole_without_room_for_its_part_is_not() -> None:
    sure = [foreseen(*towards("p3", from_m, 0.3), HOLES_M, ALIKE)["p3"] for from_m in (0.3, 0.15, 0.05)]
    assert sure == sorted(sure)
    assert foreseen(*towards("p3", 0.05, 0.3), HOLES_M, {**ALIKE, "p3": 0.0})["p3"] < 0.1
    assert foreseen((1.0, 0.0), (0.0, 0.0), {}, {}) == {}


def node_of(at: Services) -> Any:
    node: Any = alone(PositionForeseen("foreseen"), at, part="o1", plan=OPEN, state=AssemblyState({}))
    return node


def carrying(hole: str, from_m: float) -> HandSample:
    tips, velocity = towards(hole, from_m, 0.1)
    return replace(hand_at(*tips), held_part="o2", velocity_m_s=velocity)


def test_the_hand_that_goes_to_a_hole_tells_where_the_part_in_the_gripper_goes_and_for_a_while_after() -> None:
    planner = ScriptedPlanner(SURE)  # once that hole is filled
    at = services(semantic=planner)
    node = node_of(at)
    see(at, 1.0, hand=replace(carrying("p5", 0.02), held_part=None), action=Action("transit", 1.0))
    assert node.update() is Status.FAILURE
    see(at, 1.1, hand=carrying("p5", 0.02), action=Action("transit", 1.0))
    assert node.update() is Status.SUCCESS
    assert planner.asked[-1].placed == {"p5": "o2"}
    assert node.position.entry.value == "p1"
    for time_s, answer in ((4.0, Status.SUCCESS), (4.2, Status.FAILURE)):
        see(at, time_s)
        assert node.update() is answer


def test_of_a_part_that_is_placed_already_nothing_is_foreseen_while_the_hand_still_holds_it() -> None:
    planner = ScriptedPlanner(SURE)
    at = services(semantic=planner)
    node: Any = alone(PositionForeseen("foreseen"), at, part="o1", plan=OPEN, state=AssemblyState({"p5": "o2"}))
    see(at, 1.0, hand=carrying("p6", 0.02), action=Action("assembly", 1.0, "o2", "p5"))
    assert node.update() is Status.FAILURE
    assert not planner.asked
    see(at, 1.1, hand=carrying("p6", 0.02), action=Action("transit", 0.8))  # it leaves, and is still said to hold it
    assert node.update() is Status.FAILURE
    see(at, 1.2, hand=replace(carrying("p6", 0.02), held_part=None), action=Action("transit", 0.8))
    assert node.update() is Status.FAILURE
    assert not planner.asked
    see(at, 1.3, hand=carrying("p6", 0.02), action=Action("transit", 0.8))  # with the next one
    assert node.update() is Status.SUCCESS


def test_the_wait_for_the_person_begins_anew_with_the_part_that_they_bring(monkeypatch: pytest.MonkeyPatch) -> None:
    at, waited = services(semantic=ScriptedPlanner(SURE)), []

    def judged(*args: object) -> Verdict:
        waited.append(args[-1])
        return Verdict("act", "sure enough")

    monkeypatch.setattr(type(at.tools.guard), "judge", judged)
    monkeypatch.setattr(Services, "waited_s", 20.0)
    node = node_of(at)
    see(at, 1.0, hand=carrying("p5", 0.02), action=Action("transit", 1.0))
    assert node.update() is Status.SUCCESS
    assert waited == [0.0]


def test_a_hand_that_is_far_from_all_holes_foretells_nothing() -> None:
    at = services(semantic=ScriptedPlanner(SURE))
    node = node_of(at)
    see(at, 1.0, hand=carrying("p5", 0.6), action=Action("transit", 1.0))
    assert node.update() is Status.FAILURE


@pytest.mark.parametrize(("off_m", "moves"), [(0.2, False), (0.3, True)])
def test_an_arm_that_is_as_near_to_the_hole_already_does_not_go_back(off_m: float, moves: bool) -> None:
    at, (x, y) = services(), hole_m("p2")
    at.tool_on_bench_m = lambda: (x - off_m, y)  # type: ignore[method-assign]
    node: Any = alone(MoveBeside("beside"), at, position="p2")
    node.make_skill = lambda: SimpleNamespace(poll=lambda *_: Progress(SkillStatus.RUNNING, "on the way"))
    assert (node.execute() is Status.RUNNING) is moves
