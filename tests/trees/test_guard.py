"""The guard lets nothing move that is impossible, occupied, out of reach or not sure enough."""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest
import yaml

from bracket_cell.configuration import load_configuration
from bracket_cell.learned.semantic.model import BayesPlanner
from bracket_cell.trees.guard import Guard, GuardSettings
from bracket_ground.errors import InputError
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
    strange = replace(PLAN, goal_belief={"g0": 0.3, UNKNOWN_GOAL: 0.7}, next_belief={("o1", "p1"): 0.5})
    assert GUARD.judge(strange, STATE, EMPTY, "o1", "p1", reachable=True).decision == "ask"
    alone = GUARD.judge(strange, STATE, EMPTY, "o1", "p1", reachable=True, may_ask=False, waited_s=1e6)
    assert alone.decision == "wait", "where nobody answers, it is not guessed"


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


def believed(**goals: float) -> AssemblyPlan:
    """A plan of this belief over goals; a placement is as probable as the goals that want it, after p1 to p3."""
    unknown = 1.0 - sum(goals.values())
    wanted = {goal: PRODUCT.goal_placements(goal) for goal in goals}
    nexts = {
        (part, at): sum(belief for goal, belief in goals.items() if wanted[goal][at] == part)
        for part in PRODUCT.parts
        for at in ("p4", "p5", "p6")
    }
    return replace(PLAN, goal_belief={**goals, UNKNOWN_GOAL: unknown}, next_belief=nexts)


def test_what_the_next_part_shows_is_not_asked() -> None:
    either = believed(g0=0.495, g1=0.495, g2=0.0)
    outlook = GUARD.outlook(either, AssemblyState({"p1": "o1"}))
    assert outlook.ask_s >= min(outlook.act_s, outlook.wait_s)
    assert outlook.wait_s < outlook.ask_s < outlook.act_s
    assert outlook.after_one_s < outlook.act_s, "one more part tells"
    assert not GUARD.asks_for_goal(either, AssemblyState({"p1": "o1"}))


def test_a_question_is_asked_where_looks_tell_nothing_or_nothing_comes() -> None:
    assert GUARD.asks_for_goal(believed(g0=0.3, g1=0.0, g2=0.0), AssemblyState({"p1": "o1"}))
    either = believed(g0=0.495, g1=0.495, g2=0.0)
    assert GUARD.asks_for_goal(either, AssemblyState({"p1": "o1"}), waited_s=80.0)
    assert not GUARD.asks_for_goal(either, AssemblyState({}), waited_s=80.0), "nobody has begun"


def test_no_question_is_dearer_than_the_help_that_it_brings() -> None:
    names = [f"g{number}" for number in range(60)]
    every = sorted(set(permutations(PRODUCT.goals["g0"])))
    product = Product.model_validate({**PRODUCT.model_dump(), "goals": dict(zip(names, every, strict=True))})
    guard, state = Guard(product, GuardSettings()), AssemblyState({"p1": "o1"})
    fitting = [goal for goal in names if product.goals[goal][0] == "o1"]
    belief = {goal: 1.0 / len(fitting) if goal in fitting else 0.0 for goal in names}
    plan = replace(PLAN, goal_belief={**belief, UNKNOWN_GOAL: 0.0}, next_belief={("o1", "p2"): 0.4})
    assert not guard.asks_for_goal(plan, state), "any of thirty: three parts of help are worth less than a question"
    assert guard.asks_for_goal(plan, state, waited_s=30.0), "the person waits for it"


def test_what_was_misread_at_last_is_not_asked_about() -> None:
    nearly = AssemblyState(dict(zip(PRODUCT.positions[:5], ("o1", "o1", "o1", "o2", "o1"), strict=True)))
    plan = believed(g0=0.89, g1=0.0, g2=0.0)
    assert GUARD.fits_none(nearly)
    assert not GUARD.asks_for_goal(plan, nearly), "the last part tells"
    full = replace(nearly, placed={**nearly.placed, "p6": "o3"})
    assert GUARD.asks_for_goal(plan, full)


@pytest.mark.parametrize("question_s", [1.0, 10.0, 30.0])
@pytest.mark.parametrize("waited_s", [0.0, 1e4])
def test_no_act_is_expected_to_cost_more_than_a_question(question_s: float, waited_s: float) -> None:
    settings = GuardSettings(question_s=question_s)
    guard = Guard(PRODUCT, settings)
    for belief in np.linspace(0.5, 1.0, 101):
        plan = replace(PLAN, next_belief={("o1", "p1"): float(belief)})
        verdict = guard.judge(plan, STATE, EMPTY, "o1", "p1", True, may_ask=False, waited_s=waited_s)
        if verdict.decision == "act":
            assert (1.0 - belief) * settings.wrong_act_s <= question_s + 1e-9


def test_a_dearer_wrong_act_is_done_later_and_a_dearer_question_is_asked_more_rarely() -> None:
    sure, doubtful = believed(g0=0.96, g1=0.02, g2=0.0), believed(g0=0.7, g1=0.0, g2=0.0)
    state = AssemblyState({"p1": "o1"})
    for wrong_s, decision in ((100.0, "act"), (10000.0, "wait")):
        guard = Guard(PRODUCT, GuardSettings(wrong_act_s=wrong_s))
        assert guard.judge(sure, state, EMPTY, "o2", "p4", reachable=True).decision == decision
    asked = [
        Guard(PRODUCT, GuardSettings(question_s=cost_s)).asks_for_goal(doubtful, state) for cost_s in (5.0, 30.0, 300.0)
    ]
    assert asked == [True, True, False]


@pytest.mark.parametrize("name", ["taken_out", "against_told", "replaced"])
def test_what_a_person_puts_back_speaks_against_no_goal_though_no_hole_has_shown_it_yet(name: str) -> None:
    gone = replace(AssemblyState({}), **{name: {"p1": "o1", "p2": "o2"}})  # type: ignore[arg-type]
    assert getattr(gone.with_placement("o1", "p1"), name) == {"p2": "o2"}
    assert getattr(gone.with_placement("o3", "p1"), name) == {"p1": "o1", "p2": "o2"}


def test_a_part_taken_out_speaks_against_every_goal_that_wants_it_there() -> None:
    plan = believed(g0=0.9, g1=0.04, g2=0.0)
    gone = AssemblyState({"p2": "o1"}, taken_out={"p1": "o1"})
    after = plan.after_reactions(PRODUCT, gone)
    assert after.goal == UNKNOWN_GOAL
    assert sum(after.goal_belief.values()) == pytest.approx(1.0)
    assert after.goal_belief["g0"] < 0.15
    assert GUARD.judge(after, gone, EMPTY, "o2", "p4", reachable=True, may_ask=False).decision == "wait"
    told = replace(gone, told_goal="g0")
    assert plan.after_reactions(PRODUCT, told) is plan


def exchanged(before: str, after: str, position: str = "p1", **standing: str) -> AssemblyState:
    """A person's part that its hole showed was taken out, and another one put there."""
    state = AssemblyState({**standing, position: before}).seen(standing)
    return state.with_placement(after, position)


def test_an_exchange_that_alone_tells_two_products_apart_is_not_acted_on() -> None:
    goals = {"g0": ["o1", "o1", "o1", "o2", "o2", "o3"], "g1": ["o2", "o1", "o1", "o1", "o2", "o3"]}
    guard = Guard(
        Product.model_validate({**PRODUCT.model_dump(exclude={"goal_titles"}), "goals": goals}), GuardSettings()
    )
    plan, swapped = believed(g0=0.0, g1=0.999), exchanged("o1", "o2", p2="o1")
    sure = {"part": "o1", "position": "p4", "reachable": True, "waited_s": 14.0}
    plan = replace(plan, next_belief={("o1", "p4"): 0.999})
    assert guard.judge(plan, AssemblyState(swapped.placed), EMPTY, **sure).decision == "act"  # type: ignore[arg-type]
    verdict = guard.judge(plan, swapped, EMPTY, may_ask=False, **sure)  # type: ignore[arg-type]
    assert (verdict.decision, verdict.reason) == ("wait", "this fitted g0 before a person exchanged p1")
    assert guard.judge(plan, swapped, EMPTY, **{**sure, "waited_s": 1e3}).decision == "ask"  # type: ignore[arg-type]
    assert guard.judge(plan, swapped.with_goal("g1"), EMPTY, **sure).decision == "act"  # type: ignore[arg-type]
    whole = replace(swapped, placed=dict(zip(PRODUCT.positions, goals["g1"], strict=True)))
    assert not guard.asks_for_goal(plan, whole), "p4 tells, too"
    both = replace(whole, replaced={"p1": "o1", "p4": "o2"})
    assert guard.asks_for_goal(plan, both)
    assert not guard.asks_for_goal(plan, both.with_goal("g1"))


def test_who_mends_a_mistake_that_no_product_has_is_not_doubted() -> None:
    plan = replace(believed(g0=0.999), next_belief={("o1", "p2"): 0.999})
    mended = exchanged("o3", "o1", p4="o2", p5="o2")
    assert mended.replaced == {"p1": "o3"}
    assert GUARD.judge(plan, mended, EMPTY, "o1", "p2", reachable=True).decision == "act"
    assert not exchanged("o1", "o1").seen({"p1": "o1"}).replaced, "put back"
    robots = AssemblyState({"p1": "o1"}, by_robot={"p1": "o1"}).seen({})
    assert (robots.replaced, robots.taken_out) == ({}, {"p1": "o1"})
    assert not AssemblyState({"p1": "o1"}).seen({"p1": "o2"}, unread=("p1",)).replaced, "its hole never showed it"


def test_nothing_is_put_into_what_fits_no_product_before_a_person_says_that_it_is_new() -> None:
    odd = AssemblyState(dict(zip(PRODUCT.positions, ("o3", "o1", "o1", "o2", "o2"), strict=False)))
    plan = replace(believed(), next_belief={("o1", "p6"): 0.99})
    assert GUARD.fits_none(odd)
    for waited_s in (0.0, 14.0, 1e3):
        verdict = GUARD.judge(plan, odd, EMPTY, "o1", "p6", True, may_ask=False, waited_s=waited_s)
        assert (verdict.decision, verdict.reason) == ("wait", "what is in the bracket fits no product that I know")
    assert GUARD.judge(plan, odd.with_goal(UNKNOWN_GOAL), EMPTY, "o1", "p6", reachable=True).decision == "act"


def test_own_parts_say_as_much_of_a_goal_as_people_look_at_them() -> None:
    """P(g0 | a person's part at p6, the robot's at p1) by hand; 20 arrangements are left of the 60, 57 unlisted."""
    people, both = {"p6": "o3"}, {"p6": "o3", "p1": "o1"}
    planner, beliefs = BayesPlanner(PRODUCT), []
    for share in (0.0, 0.3, 1.0):
        guard = Guard(PRODUCT, GuardSettings(left_in_share=share))
        plan = guard.planned(planner, AssemblyState(both, by_robot={"p1": "o1"}))
        assert guard.refusal(plan, AssemblyState(both, by_robot={"p1": "o1"})) is None
        assert not any(at in both for _, at in plan.next_belief)
        assert plan.guidance["o1"] == ("p2", "p3")
        assert sum(plan.goal_belief.values()) == pytest.approx(1.0)
        beliefs.append(plan.goal_belief[UNKNOWN_GOAL])
    before = planner.plan(AssemblyState(people)).goal_belief[UNKNOWN_GOAL]
    assert beliefs[0] == pytest.approx(planner.plan(AssemblyState(both)).goal_belief[UNKNOWN_GOAL])
    assert beliefs[2] == pytest.approx(before), "what the robot did itself is no news"
    assert beliefs[0] < beliefs[1] < beliefs[2]
    told = AssemblyState(both, by_robot={"p1": "o1"}, told_goal="g0")
    assert Guard(PRODUCT, GuardSettings(left_in_share=1.0)).planned(planner, told) == planner.plan(told)


@pytest.mark.parametrize("share", [0.3, 1.0])
def test_whatever_the_robot_placed_the_plan_can_be_used(share: float) -> None:
    guard, planner = Guard(PRODUCT, GuardSettings(left_in_share=share)), BayesPlanner(PRODUCT)
    rng = np.random.default_rng(7)
    for _ in range(60):
        arrangement = rng.permutation([name for name, part in PRODUCT.parts.items() for _ in range(part.quantity)])
        count = int(rng.integers(1, 7))
        placed = dict(zip(rng.permutation(PRODUCT.positions)[:count].tolist(), arrangement.tolist(), strict=False))
        own = {at: part for at, part in placed.items() if rng.random() < 0.5}
        plan = guard.planned(planner, AssemblyState(placed, by_robot=own))
        assert sum(plan.goal_belief.values()) == pytest.approx(1.0)
        assert all(0.0 <= belief <= 1.0 for belief in plan.next_belief.values())
        assert not placed.keys() & {at for _, at in plan.next_belief}
        assert (plan.next_part is None) or count < 6


def test_the_dearer_it_is_to_wait_the_sooner_the_robot_acts() -> None:
    plan, state = believed(g0=0.955, g1=0.02, g2=0.0), AssemblyState({"p1": "o1"})
    decided = [
        Guard(PRODUCT, GuardSettings(placement_s=cost_s)).judge(plan, state, EMPTY, "o2", "p4", True, False).decision
        for cost_s in (0.5, 20.0)
    ]
    assert decided == ["wait", "act"]


def test_the_last_part_is_not_held_until_the_person_has_placed_theirs() -> None:
    """Nothing is learned by that, and what the robot holds must go back."""
    whole = PRODUCT.goal_placements("g0")
    plan, state = believed(g0=0.98, g1=0.0, g2=0.0), AssemblyState({at: whole[at] for at in whole if at != "p4"})
    guard = Guard(PRODUCT, GuardSettings(placement_s=4.0))
    assert guard.judge(plan, state, EMPTY, whole["p4"], "p4", True, False).decision == "act"
    unsure = believed(g0=0.97, g1=0.0, g2=0.0)
    assert guard.judge(unsure, state, EMPTY, whole["p4"], "p4", True, False).decision == "wait"


@pytest.mark.parametrize("key", ["act_probability", "doubt_probability", "ask_probability", "wrong_share"])
def test_a_file_with_a_threshold_of_before_is_told_what_to_write(key: str, tmp_path: Path) -> None:
    text = Path("config/cell.yaml").read_text().replace("  wrong_act_s: 300.0", f"  {key}: 0.9")
    path = tmp_path / "cell.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=r"cell.yaml:\d+.*write wrong_act_s and question_s"):
        load_configuration(path)


def test_where_slots_stay_empty_a_part_too_many_is_asked_about_once_the_likeliest_goal_is_whole() -> None:
    goals = {"short": ["o1", "empty", "empty", "o2", "o2", "o3"], "long": ["o1", "o1", "o1", "o2", "o2", "o3"]}
    family = Product.model_validate({**PRODUCT.model_dump(exclude={"goal_titles"}), "goals": goals})
    guard, plan = Guard(family, GuardSettings()), replace(PLAN, goal_belief={"short": 0.8, "long": 0.2})
    whole = {"p1": "o1", "p4": "o2", "p5": "o2", "p6": "o3"}
    assert not guard.asks_for_goal(plan, AssemblyState(whole))
    odd = AssemblyState({**whole, "p2": "o3"})
    assert guard.fits_none(odd)
    assert guard.asks_for_goal(plan, odd)
    del whole["p1"]
    assert not guard.asks_for_goal(plan, AssemblyState({**whole, "p2": "o3"})), "the next part tells"
