"""Goals that nobody listed: brackets one after the other, of goals in use that the product file does not all name."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from bracket_cell.learned.inference.scores import ScoreCounter
from bracket_cell.learned.semantic.confusions import PATTERNS, Confusions, Pattern
from bracket_cell.learned.semantic.goals import FinishedGoal, OpenGoals
from bracket_cell.learned.semantic.graph import EMPTY, Ints, Layout
from bracket_cell.learned.semantic.misdetection import Scenarios, misdetect
from bracket_cell.learned.semantic.model import BayesPlanner, FactoredPlanner
from bracket_cell.trees.guard import Guard, GuardSettings
from bracket_ground.interfaces.perception import HoleView
from bracket_ground.interfaces.planning import UNKNOWN_GOAL, AssemblyState
from bracket_ground.interfaces.product import Product
from bracket_lab.experiments.experiments import Cell, Values
from bracket_lab.experiments.semantic_models import planner_of
from bracket_lab.learned.semantic.scenarios import scenarios

SEEDS = tuple(range(1, 6))
IN_USE = (3, 6, 12)  # goals, three of them listed
BRACKETS = 60
SINGLE = 400  # assemblies of goals that are met for the first time, and of known ones
ERROR = 0.05
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
            for answers in (False, True):
                met = {"experiment": "streams", "kind": kind, "pattern": pattern, "answers": answers, "seed": SEEDS[0]}
                cells.append(Cell(met, partial(first_meetings, product, kind, pattern, answers, SEEDS[0])))
    return cells


def _stream(product: Product, kind: str, in_use: int, rule: str, seed: int) -> Values:
    layout, rng = Layout.of(product), np.random.default_rng([seed, in_use])
    used = [*layout.types[: min(in_use, len(layout.types))], *unlisted(layout, in_use - len(layout.types), rng)]
    confusions = Confusions.of(layout, "alike types", ERROR)
    make = _maker(kind, product, confusions, seed)
    goals = OpenGoals.of(product)
    planner, counter = make(goals), ScoreCounter()
    for number in range(BRACKETS):
        types = used[rng.integers(in_use)]
        guard = Guard(goals.product, GuardSettings())
        found = assemble(planner, guard, types, confusions, rng, answers=rule.endswith("question"))
        for half in ("", "_second_half") if number >= BRACKETS // 2 else ("",):
            _count(counter, found, half)
        if rule != "fixed list":
            goals = goals.with_bracket(tuple(layout.parts[part] for part in types))
            planner = make(goals)
    return dict(counter.scores())


def first_meetings(product: Product, kind: str, pattern: Pattern, answers: bool, seed: int) -> Values:
    """Assemblies of listed goals, of goals that were never shown, and of those after they were finished twice."""
    layout, rng = Layout.of(product), np.random.default_rng([seed, 99])
    confusions = Confusions.of(layout, pattern, ERROR)
    make = _maker(kind, product, confusions, seed)
    counter = ScoreCounter()
    fresh, guard = make(OpenGoals.of(product)), Guard(product, GuardSettings())
    for types in layout.types[rng.integers(len(layout.types), size=SINGLE)]:
        _count(counter, assemble(fresh, guard, types, confusions, rng, answers=answers), "_known")
    for number, types in enumerate(unlisted(layout, SINGLE, rng, repeated=True)):
        _count(counter, assemble(fresh, guard, types, confusions, rng, answers=answers), "_unknown")
        if number % 5 == 0:
            parts = tuple(layout.parts[part] for part in types)
            draws = rng.integers(2**32)
            for times, name in ((2, "_seen_twice"), (AS_LISTED, "_as_listed")):
                goals = OpenGoals(product, {"new1": FinishedGoal(parts=parts, finished=times)})
                told = Guard(goals.product, GuardSettings())
                found = assemble(make(goals), told, types, confusions, np.random.default_rng(draws), answers=answers)
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
    guard: Guard,
    types: Ints,
    confusions: Confusions | None,
    rng: np.random.Generator,
    *,
    answers: bool,
) -> list[dict[str, bool]]:
    """One bracket in random order: what would the guard do after each action but the last, and rightly?

    A camera sees which holes are filled: reports of open ones are dropped. The first wrong act is taken out again at
    once; then that part, at that position, speaks against the goals that want it.

    Args:
        answers: the first question is answered truly, before anything else.
    """
    layout, m = planner.layout, len(types)
    order, product = rng.permutation(m), guard.product
    state, states = AssemblyState({}), []
    for count in range(1, m):
        true, seen = seen_after(layout, types, order[:count], confusions, rng)
        state = replace(state, placed=layout.state(seen).placed)
        plan = planner.plan(state).after_reactions(product, state)
        asked = answers and state.told_goal is None and guard.asks_for_goal(plan, state)
        if asked:
            known = zip(layout.goals, layout.types.tolist(), strict=True)
            state = state.told(next((goal for goal, row in known if row == types.tolist()), UNKNOWN_GOAL))
            plan = planner.plan(state)
        holes = {
            at: HoleView(None if part == EMPTY else "", 1.0, 0.0)
            for at, part in zip(layout.positions, true, strict=True)
        }
        acts = [
            (belief, placement)
            for placement, belief in plan.next_belief.items()
            if guard.judge(plan, state, holes, *placement, reachable=True, may_ask=answers).decision == "act"
        ]
        placement = max(acts)[1] if acts else None
        wrong = placement is not None and layout.parts[types[layout.positions.index(placement[1])]] != placement[0]
        if wrong and placement is not None:
            state = replace(state, taken_out={**state.taken_out, placement[1]: placement[0]})
        states.append({"acts": placement is not None, "wrong": wrong, "asked": asked})
    return states


def seen_after(
    layout: Layout, types: Ints, done: Ints, confusions: Confusions | None, rng: np.random.Generator
) -> tuple[Ints, Ints]:
    """A bracket (m,) after the positions `done` were filled: as it is, and as it was reported.

    A camera sees which holes are filled: reports of open ones are dropped.
    """
    true: Ints = np.where(np.isin(np.arange(len(types)), done), types, EMPTY)
    some = Scenarios(np.zeros(1, int), true[None], np.zeros(1, int))
    reported = misdetect(layout, some, rng, confusions=None if confusions is None else confusions.matrix).seen[0]
    return true, np.where(true == EMPTY, EMPTY, reported)


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
