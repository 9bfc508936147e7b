"""Goal inference over families: against listing every arrangement, and that it says where it is approximate."""

from __future__ import annotations

from itertools import permutations
from math import comb
from typing import Any

import numpy as np
import pytest

from bracket_cell.learned.semantic.confusions import ConfusionLikelihood, Confusions, Pattern, Reports
from bracket_cell.learned.semantic.graph import Layout
from bracket_cell.learned.semantic.model import BayesPlanner
from bracket_cell.learned.semantic.posterior import (
    MOST_STATES,
    FactoredConfusions,
    Noise,
    UniformLikelihood,
    UnknownGoal,
    confusion_likelihood,
)
from bracket_ground.interfaces.planning import UNKNOWN_GOAL, AssemblyState
from bracket_ground.interfaces.product import Product
from bracket_ground.interfaces.variants import EMPTY, arrangements
from tests.learned.products import DEFAULT

GOALS: dict[str, list[Any]] = {
    "a": ["o1", "o1", "o1", "o2", "o2", "o3"],
    "b": ["o2", ["o1", "o3"], "o2", EMPTY, ["o1", "o2"], "o1"],
    "c": [EMPTY, EMPTY, "o3", "o1", ["o1", "o2"], ["o1", "o2"]],
}


def family(goals: dict[str, Any], **more: Any) -> Product:
    parts = {name: part.model_dump(exclude={"quantity"}) for name, part in DEFAULT.parts.items()}
    return Product.model_validate({**DEFAULT.model_dump(), "parts": parts, "goals": goals, "goal_titles": {}, **more})


FAMILY = family(GOALS)


def states() -> list[dict[str, str]]:
    rng = np.random.default_rng(5)
    found = []
    for _ in range(40):
        at = rng.permutation(FAMILY.positions)[: rng.integers(0, 6)]
        found.append({str(position): f"o{rng.integers(1, 4)}" for position in at})
    return found


def test_the_likelihood_is_the_mean_over_all_arrangements_of_a_goal() -> None:
    layout = Layout.of(FAMILY)
    noise = Noise.of(layout, 0.1)
    closed = UniformLikelihood(layout, noise)
    for placed in states():
        found, _ = closed(layout.encode(AssemblyState(placed)))
        for number, goal in enumerate(GOALS):
            every = arrangements(FAMILY.goals[goal], {}, 100)
            listed = [_listed(dict(zip(FAMILY.positions, one, strict=True)), placed, noise) for one in every]
            assert found[number] == pytest.approx(np.mean(listed), rel=1e-9), (goal, placed)


def _listed(arrangement: dict[str, str], placed: dict[str, str], noise: Noise) -> float:
    """Sum over all ways in which the reports may stem from slots of one arrangement."""
    slots = [at for at, part in arrangement.items() if part != EMPTY]
    k = len(placed)
    if k > len(slots):
        return 0.0
    total = 0.0
    for way in permutations(slots, k):
        right = [slot == at and arrangement[slot] == part for slot, (at, part) in zip(way, placed.items(), strict=True)]
        total += float(np.prod([noise.wrong[k] + noise.excess[k] * one for one in right]))
    return total / comb(len(slots), k)


def test_the_mean_over_what_nobody_listed_is_that_of_listing_it() -> None:
    layout = Layout.of(family({"a": GOALS["a"]}))
    noise = Noise.of(layout, 0.1)
    every = sorted(set(permutations(GOALS["a"])))
    for placed in states()[:12]:
        edges = layout.encode(AssemblyState(placed))
        mean, still_open = UnknownGoal(layout, noise).mean(tuple(edges.sum(axis=1).astype(int).tolist()))
        listed = [_listed(dict(zip(FAMILY.positions, one, strict=True)), placed, noise) for one in every]
        assert mean == pytest.approx(np.mean(listed) * len(every) / (len(every) - 1), rel=1e-9)
        assert still_open[-1] == 0.0


@pytest.mark.parametrize(("pattern", "exact"), [("alike types", True), ("neighbouring holes", False)])
def test_factored_confusions_are_those_of_listing_all_slots(pattern: Pattern, exact: bool) -> None:
    layout = Layout.of(family({**GOALS, "any": [["o1", "o2", "o3"]] * 6}))  # every type has an alike one everywhere
    confusions = Confusions.of(layout, pattern, 0.2)
    listed, factored = ConfusionLikelihood(layout, confusions), FactoredConfusions(layout, confusions)
    assert bool(factored.approximate) != exact
    fitting = [dict(list(FAMILY.goal_placements(goal).items())[:n]) for goal in GOALS for n in (1, 2, 3, 4)]
    for placed in [*states(), *fitting]:
        edges = layout.encode(AssemblyState(placed))
        one, other = listed(edges), factored(edges)
        if exact:
            assert np.allclose(one[0], other[0], rtol=1e-6, atol=1e-12)
            assert np.allclose(one[1] * (edges.sum(axis=0) == 0), other[1] * (edges.sum(axis=0) == 0), rtol=1e-6)
        elif any(FAMILY.fits(goal, placed) for goal in GOALS):
            assert np.abs(one[0] / one[0].sum() - other[0] / other[0].sum()).max() < 0.1


def test_confusions_count_at_every_size() -> None:
    """From 11 slots on they were dropped, and nothing said so."""
    holes = {f"p{i}": [0.1 * (i // 7), 0.08 * (i % 7)] for i in range(14)}
    goals = {f"g{i}": [f"o{1 + (i * slot + slot // 2) % 3}" for slot in range(14)] for i in range(3)}
    some = family(goals, bracket={**DEFAULT.bracket.model_dump(), "holes_m": holes})
    layout = Layout.of(some)
    confusions = Confusions.of(layout, "neighbouring holes", 0.2)
    assert MOST_STATES < 2**14 * 14 * 3
    assert isinstance(confusion_likelihood(layout, confusions), FactoredConfusions)
    state = AssemblyState({"p3": str(some.goals["g1"][3]), "p5": str(some.goals["g2"][5])})
    plain, confused = BayesPlanner(some), BayesPlanner(some, confusions=confusions)
    assert plain.plan(state).goal_belief != confused.plan(state).goal_belief
    assert plain.plan(state).inference == "exact"
    assert confused.plan(state).inference == "approximate: confusions between 14 slots count by their mean"


def test_a_position_that_another_report_takes_is_not_reported_again() -> None:
    layout = Layout.of(DEFAULT)
    reports = Reports(Confusions.of(layout, "neighbouring holes", 0.3), 6)
    alone = reports.chances(layout.encode(AssemblyState({"p2": "o1"})))[1]
    beside = reports.chances(layout.encode(AssemblyState({"p2": "o1", "p4": "o1"})))[1]
    p3 = layout.parts.index("o1") * 6 + 2  # its neighbours are p2 and p4: with p4 taken all its mistakes go to p2
    assert beside[0][p3] == pytest.approx(2 * alone[0][p3])


def test_slots_that_share_parts_exchange_them() -> None:
    goals = {**GOALS, "d": [["o1", "o2"], ["o1", "o2"], "o3", "o3", "o3", EMPTY]}
    planner = BayesPlanner(family(goals, goal_quantities={"d": {"o1": 1, "o2": 1}}))
    placed = {"p3": "o3", "p4": "o3", "p5": "o3"}
    before = planner.plan(AssemblyState(placed))
    assert before.goal == "d"
    assert before.next_belief["o1", "p1"] > 0.9
    assert before.next_belief["o2", "p1"] > 0.9
    after = planner.plan(AssemblyState({**placed, "p2": "o1"}))
    assert after.next_belief["o2", "p1"] > 0.9
    assert after.next_belief.get(("o1", "p1"), 0.0) < 0.1
    assert after.guidance["o2"] == ("p1",)
    assert after.guidance["o1"] == ()


def test_every_type_that_is_right_has_a_place_in_the_plan() -> None:
    """A robot that holds the other one of two types that are right would wait for ever."""
    planner = BayesPlanner(
        family({"e": ["o3", "o3", ["o1", "o2"], "o1", "o2", EMPTY], "f": [*["o1"] * 3, *["o2"] * 3]})
    )
    placed = {"p1": "o3", "p2": "o3", "p4": "o1", "p5": "o2"}
    plan = planner.plan(AssemblyState(placed))
    assert plan.goal == "e"
    assert (plan.guidance["o1"], plan.guidance["o2"]) == (("p3",), ("p3",))


def test_the_plan_of_a_type_names_no_more_places_than_parts_are_left() -> None:
    limits = {"g": {"o1": 1, "o2": 1}}
    planner = BayesPlanner(
        family({**GOALS, "g": [["o1", "o2"], ["o1", "o2"], *["o3"] * 3, EMPTY]}, goal_quantities=limits)
    )
    plan = planner.plan(AssemblyState({"p3": "o3", "p4": "o3", "p5": "o3"}))
    assert plan.goal == "g"
    assert sorted((len(plan.guidance["o1"]), len(plan.guidance["o2"]))) == [1, 1]
    assert {*plan.guidance["o1"], *plan.guidance["o2"]} == {"p1", "p2"}


def test_an_empty_slot_is_wanted_by_nobody() -> None:
    plan = BayesPlanner(FAMILY).plan(AssemblyState({"p3": "o3", "p4": "o1"}))
    assert plan.goal == "c"
    assert max(plan.next_belief.get((part, "p1"), 0.0) for part in FAMILY.parts) < 0.2
    assert all("p1" not in to for to in plan.guidance.values())


def test_more_parts_than_any_goal_takes_are_none_of_these() -> None:
    some = family({"a": ["o1", "o2", *[EMPTY] * 4], "b": ["o2", "o3", *[EMPTY] * 4]})
    plan = BayesPlanner(some).plan(AssemblyState({"p1": "o1", "p2": "o2", "p3": "o3"}))
    assert plan.goal == UNKNOWN_GOAL


def test_quantities_that_leave_too_much_open_are_told() -> None:
    any_part = [["o1", "o2", "o3"]] * 6
    some = family({"a": any_part}, goal_quantities={"a": {"o1": 2, "o2": 2, "o3": 2}})
    assert BayesPlanner(some).plan(AssemblyState({})).inference == "exact"
    holes = {f"p{i}": [0.1 * (i // 7), 0.08 * (i % 7)] for i in range(12)}
    bracket = {**DEFAULT.bracket.model_dump(), "holes_m": holes}
    some = family({"a": any_part * 2}, goal_quantities={"a": {"o1": 4, "o2": 4, "o3": 4}}, bracket=bracket)
    assert BayesPlanner(some).plan(AssemblyState({})).inference.startswith("approximate: the quantities of a leave")
