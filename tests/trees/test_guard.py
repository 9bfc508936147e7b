"""The guard lets nothing move that is impossible, occupied, out of reach or not sure enough."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from bracket_cell.trees.guard import Guard, GuardSettings
from bracket_ground.interfaces.perception import HoleView
from bracket_ground.interfaces.planning import UNKNOWN_GOAL, AssemblyPlan, AssemblyState
from bracket_ground.interfaces.product import Product

PRODUCT = Product.model_validate(yaml.safe_load(Path("config/products.yaml").read_text()))
GUARD = Guard(PRODUCT, GuardSettings())
STATE = AssemblyState({"p6": "o3"})
PLAN = AssemblyPlan(
    goal_belief={"g0": 0.97, "g1": 0.02, "g2": 0.01},
    next_belief={("o1", "p1"): 0.98, ("o1", "p2"): 0.99, ("o2", "p4"): 0.6},
    next_part="o1",
    guidance={"o1": ("p1", "p2", "p3"), "o2": ("p4", "p5"), "o3": ()},
)
EMPTY = {position: HoleView(None, 1.0, 0.0) for position in PRODUCT.positions}


def test_a_sure_and_possible_placement_is_acted_on() -> None:
    assert GUARD.judge(PLAN, STATE, EMPTY, "o1", "p1", reachable=True).decision == "act"


def test_an_unsure_placement_waits() -> None:
    verdict = GUARD.judge(PLAN, STATE, EMPTY, "o2", "p4", reachable=True)
    assert verdict.decision == "wait"
    assert "0.60" in verdict.reason


def test_a_hole_seen_filled_waits_even_when_the_graph_says_open() -> None:
    seen = {**EMPTY, "p1": HoleView("o2", 1.0, 0.0)}
    assert GUARD.judge(PLAN, STATE, seen, "o1", "p1", reachable=True).decision == "wait"


def test_a_hole_never_seen_waits() -> None:
    assert GUARD.judge(PLAN, STATE, {}, "o1", "p1", reachable=True).decision == "wait"


def test_where_the_graph_is_trusted_a_hole_that_nothing_reads_is_as_the_graph_says() -> None:
    trusting = Guard(PRODUCT, GuardSettings(holes="graph"))
    assert trusting.judge(PLAN, STATE, {}, "o1", "p1", reachable=True).decision == "act"
    filled = {"p1": HoleView("o2", 1.0, 0.0)}
    assert trusting.judge(PLAN, STATE, filled, "o1", "p1", reachable=True).decision == "wait"
    assert trusting.judge(PLAN, STATE, {}, "o2", "p4", reachable=True).decision == "wait"


def test_nothing_remaining_waits() -> None:
    assert GUARD.judge(PLAN, STATE, EMPTY, "o3", "p1", reachable=True).decision == "wait"


def test_out_of_reach_and_unknown_goals_ask() -> None:
    assert GUARD.judge(PLAN, STATE, EMPTY, "o1", "p1", reachable=False).decision == "ask"
    strange = replace(PLAN, goal_belief={"g0": 0.3, UNKNOWN_GOAL: 0.7})
    assert GUARD.judge(strange, STATE, EMPTY, "o1", "p1", reachable=True).decision == "ask"


def test_a_possible_plan_is_not_refused() -> None:
    assert GUARD.refusal(PLAN, STATE) is None


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"goal_belief": {"g0": float("nan"), "g1": 1.0}}, "outside 0..1"),
        ({"goal_belief": {"g0": 0.4, "g1": 0.4}}, "sums to"),
        ({"goal_belief": {"g9": 1.0}}, "unknown goals"),
        ({"next_belief": {("o1", "p1"): float("inf")}}, "belief of o1"),
        ({"next_belief": {("o7", "p1"): 0.5}}, "unknown placement"),
        ({"next_part": "o7"}, "unknown next part"),
        ({"guidance": {"o7": ()}}, "unknown part"),
        ({"guidance": {"o1": ("p9",)}}, "unknown positions"),
        ({"guidance": {"o1": ("p6",)}}, "filled positions"),
        ({"guidance": {"o1": ("p1", "p1")}}, "remain"),
        ({"guidance": {"o3": ("p1",)}}, "0 remain"),
    ],
)
def test_impossible_plans_are_refused_with_the_reason(change: dict[str, object], reason: str) -> None:
    refusal = GUARD.refusal(replace(PLAN, **change), STATE)  # type: ignore[arg-type]
    assert refusal is not None
    assert reason in refusal


def test_where_many_goals_are_in_use_a_thin_margin_is_asked_about_or_waits() -> None:
    wary = Guard(PRODUCT, GuardSettings(), 0.95)
    thin = replace(PLAN, next_belief={("o1", "p1"): 0.93}, goal_belief={"g0": 1.0, "g1": 0.0, "g2": 0.0})
    holes = {"p1": HoleView(None, 1.0, 0.0)}
    asked = wary.judge(thin, AssemblyState({}), holes, "o1", "p1", reachable=True)
    alone = wary.judge(thin, AssemblyState({}), holes, "o1", "p1", reachable=True, may_ask=False)
    assert (asked.decision, alone.decision) == ("ask", "wait")
    assert "0.930 < 0.950" in alone.reason
    assert wary.asks_for_goal(thin, AssemblyState({}))
    assert not GUARD.asks_for_goal(thin, AssemblyState({}))
    assert GUARD.judge(thin, AssemblyState({}), holes, "o1", "p1", reachable=True).decision == "act"
