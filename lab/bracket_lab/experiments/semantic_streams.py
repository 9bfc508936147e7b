"""Goals that nobody listed: brackets one after the other, of goals in use that the product file does not all name."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from bracket_cell.learned.inference.scores import ScoreCounter
from bracket_cell.learned.semantic.confusions import PATTERNS, Confusions, Pattern
from bracket_cell.learned.semantic.goals import FinishedGoal, OpenGoals
from bracket_cell.learned.semantic.graph import EMPTY, Ints, Layout
from bracket_cell.learned.semantic.model import BayesPlanner, FactoredPlanner
from bracket_cell.learned.semantic.risk import act_probability, seen_after
from bracket_ground.interfaces.planning import UNKNOWN_GOAL, AssemblyPlan, AssemblyState
from bracket_ground.interfaces.product import Product
from bracket_lab.experiments.experiments import Cell, Values
from bracket_lab.experiments.semantic_models import planner_of
from bracket_lab.learned.semantic.scenarios import scenarios

SEEDS = tuple(range(1, 6))
IN_USE = (3, 6, 12)  # goals, three of them listed
BRACKETS = 60
SINGLE = 400  # assemblies of goals that are met for the first time, and of known ones
ERROR = 0.05
ACT, ASK, DOUBT, WRONG = 0.9, 0.5, 0.01, 0.02  # the guard's thresholds, and the share of acts that may be wrong
NEVER = 1.0  # a doubt that never asks
AS_LISTED = 4  # finished brackets that make a goal as probable as a listed one


def stream_cells(product: Product) -> list[Cell]:
    """Streams with a fixed and an open list, with and without questions; first meetings by pattern of confusions."""
    cells = []
    for kind in ("factored", "bayes"):
        for seed in SEEDS:
            for in_use in IN_USE:
                for rule in ("fixed list", "open list", "open list, one question"):
                    key = {"experiment": "streams", "kind": kind, "in_use": in_use, "rule": rule, "seed": seed}
                    cells.append(Cell(key, partial(_stream, product, kind, in_use, rule, seed)))
        for pattern in PATTERNS:
            for doubt in (NEVER, DOUBT):
                met = {"experiment": "streams", "kind": kind, "pattern": pattern, "doubt": doubt, "seed": SEEDS[0]}
                cells.append(Cell(met, partial(first_meetings, product, kind, pattern, doubt, SEEDS[0])))
    return cells


def _stream(product: Product, kind: str, in_use: int, rule: str, seed: int) -> Values:
    layout, rng = Layout.of(product), np.random.default_rng([seed, in_use])
    used = [*layout.types[: min(in_use, len(layout.types))], *unlisted(layout, in_use - len(layout.types), rng)]
    confusions = Confusions.of(layout, "alike types", ERROR)
    make = _maker(kind, product, confusions, seed)
    goals = OpenGoals.of(product)
    planner, act, counter = make(goals), ACT, ScoreCounter()
    for number in range(BRACKETS):
        types = used[rng.integers(in_use)]
        doubt = DOUBT if rule.endswith("question") else NEVER
        found = assemble(planner, layout, types, confusions, rng, doubt, act)
        for half in ("", "_second_half") if number >= BRACKETS // 2 else ("",):
            _count(counter, found, half)
        if rule != "fixed list":
            goals = goals.with_bracket(tuple(layout.parts[part] for part in types))
            planner = make(goals)
            act = act_probability(planner, goals, confusions, ACT, WRONG)
    return dict(counter.scores())


def first_meetings(product: Product, kind: str, pattern: Pattern, doubt: float, seed: int) -> Values:
    """Assemblies of listed goals, of goals that were never shown, and of those after they were finished twice."""
    layout, rng = Layout.of(product), np.random.default_rng([seed, 99])
    confusions = Confusions.of(layout, pattern, ERROR)
    make = _maker(kind, product, confusions, seed)
    counter = ScoreCounter()
    fresh = make(OpenGoals.of(product))
    for types in layout.types[rng.integers(len(layout.types), size=SINGLE)]:
        _count(counter, assemble(fresh, layout, types, confusions, rng, doubt), "_known")
    for number, types in enumerate(unlisted(layout, SINGLE, rng, repeated=True)):
        _count(counter, assemble(fresh, layout, types, confusions, rng, doubt), "_unknown")
        if number % 5 == 0:
            parts = tuple(layout.parts[part] for part in types)
            draws = rng.integers(2**32)
            for times, name in ((2, "_seen_twice"), (AS_LISTED, "_as_listed")):
                goals = OpenGoals(product, {"new1": FinishedGoal(parts=parts, finished=times)})
                planner = make(goals)
                act = act_probability(planner, goals, confusions, ACT, WRONG)
                found = assemble(planner, layout, types, confusions, np.random.default_rng(draws), doubt, act)
                _count(counter, found, name)
    return dict(counter.scores())


def unlisted(layout: Layout, count: int, rng: np.random.Generator, *, repeated: bool = False) -> list[Ints]:
    """Arrangements of the product's parts that are none of its goals."""
    parts = np.repeat(np.arange(len(layout.parts)), layout.quantities)
    known = {tuple(row) for row in layout.types.tolist()}
    found: list[Ints] = []
    while len(found) < count:
        types = rng.permutation(parts)
        if tuple(types.tolist()) not in known:
            found.append(types)
            if not repeated:
                known.add(tuple(types.tolist()))
    return found


def assemble(
    planner: BayesPlanner | FactoredPlanner,
    layout: Layout,
    types: Ints,
    confusions: Confusions,
    rng: np.random.Generator,
    doubt: float,
    act: float = ACT,
) -> list[dict[str, bool]]:
    """One bracket in random order: would the robot act after each action but the last, and rightly?

    It acts from the probability `act` on. A camera sees which holes are filled; reports of open ones are dropped. Where
    the robot would act for the first time from ACT on, and "none of these" has the probability `doubt` or the placement
    less than `act`, it asks which of the known goals it is, once, and is told; with a doubt of NEVER nobody is asked.
    """
    m = len(types)
    order = rng.permutation(m)
    told: str | None = None
    states = []
    for count in range(1, m):
        true, seen = seen_after(layout, types, order[:count], confusions, rng)
        plan = planner.plan(AssemblyState(layout.state(seen).placed, told))
        placement = _placement(plan, layout, true, min(act, ACT))
        thin = placement is not None and plan.next_belief[placement] < act
        asked = (
            placement is not None
            and told is None
            and doubt < NEVER
            and (plan.goal_belief[UNKNOWN_GOAL] >= doubt or thin)
        )
        if asked:
            known = zip(planner.layout.goals, planner.layout.types.tolist(), strict=True)
            told = next((goal for goal, row in known if row == types.tolist()), UNKNOWN_GOAL)
            placement = _placement(planner.plan(AssemblyState(layout.state(seen).placed, told)), layout, true, act)
        elif thin:
            placement = None
        states.append(_state(placement, layout, types, asked=asked))
    return states


def _placement(plan: AssemblyPlan, layout: Layout, true: Ints, act: float) -> tuple[str, str] | None:
    """The best placement into an open hole, where it is sure enough."""
    if plan.goal_belief[UNKNOWN_GOAL] >= ASK:
        return None
    possible = {
        place: value for place, value in plan.next_belief.items() if true[layout.positions.index(place[1])] == EMPTY
    }
    best = max(possible, key=possible.__getitem__, default=None)
    return best if best is not None and possible[best] >= act else None


def _state(placement: tuple[str, str] | None, layout: Layout, types: Ints, *, asked: bool) -> dict[str, bool]:
    wrong = placement is not None and layout.parts[types[layout.positions.index(placement[1])]] != placement[0]
    return {"acts": placement is not None, "wrong": wrong, "asked": asked}


def _count(counter: ScoreCounter, states: list[dict[str, bool]], end: str) -> None:
    for state in states:
        counter.add(f"coverage{end}", state["acts"])
        if state["acts"]:
            counter.add(f"wrong_acts{end}", state["wrong"])
    counter.add(f"wrong_assemblies{end}", any(state["wrong"] for state in states))
    counter.add(f"asked{end}", any(state["asked"] for state in states))


def _maker(kind: str, product: Product, confusions: Confusions, seed: int) -> Any:
    """Planners of one kind, by the goals that are known."""
    if kind == "bayes":
        return lambda goals: BayesPlanner(goals.listed, goals, confusions)
    trained = planner_of("factored", product, scenarios(Layout.of(product), seed), seed)
    assert isinstance(trained, FactoredPlanner)
    return lambda goals: trained.with_goals(goals, confusions)
