"""What the guard's two costs lead to: wrong acts and questions, by how many goals are listed and who answers.

python -m tests.benchmarks.decisions --brackets 400 --seed 101
The exact planner; whole brackets of the valve bracket's parts in random orders, of goals that are listed or not. What
is reported is true, or 4.5 % of it is taken for something else and no camera corrects that. Nothing moves. 95 %
intervals by Wilson.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.fleet.intervals import wilson
from bracket_cell.learned.semantic.confusions import Confusions
from bracket_cell.learned.semantic.goals import OpenGoals
from bracket_cell.learned.semantic.graph import EMPTY, Ints, Layout
from bracket_cell.learned.semantic.model import BayesPlanner
from bracket_cell.learned.semantic.settings import DETECTION_ERROR
from bracket_cell.trees.guard import Guard, GuardSettings
from bracket_ground.interfaces.perception import HoleView
from bracket_ground.interfaces.planning import UNKNOWN_GOAL, AssemblyState
from bracket_ground.interfaces.product import Product
from bracket_lab.learned.semantic.misdetection import Scenarios, misdetect

LISTED = (3, 12, 60)  # goals; 60 are all arrangements that there are
SHIPPED = load_configuration().guard
Brackets = Sequence[Sequence[dict[str, bool]]]


@dataclass(frozen=True)
class Row:
    """What is drawn: how many goals are listed, whether the bracket is one, whether reports err, who answers."""

    goals: int
    listed: bool
    errs: bool
    answers: bool


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--brackets", type=int, default=400)
    parser.add_argument("--seed", type=int, default=101)
    parser.add_argument("--wrong", type=float, default=SHIPPED.wrong_act_s, help="guard.wrong_act_s")
    parser.add_argument("--question", type=float, default=SHIPPED.question_s, help="guard.question_s")
    parser.add_argument("--goals", type=int, nargs="+", default=LISTED, choices=LISTED, help="listed goals")
    options = parser.parse_args()
    guard = SHIPPED.model_copy(update={"wrong_act_s": options.wrong, "question_s": options.question})
    print("goals bracket  reports answers | wrong acts | brackets with a wrong act | asked | acts in | first act after")
    for row in (row for row in rows() if row.goals in options.goals):
        print(told(row, drawn(row, guard, options.brackets, options.seed)), flush=True)


def rows() -> Iterator[Row]:
    """All rows; every arrangement is listed where 60 are."""
    for goals in LISTED:
        for listed in (True, False) if goals < max(LISTED) else (True,):
            for errs in (False, True):
                for answers in (False, True):
                    yield Row(goals, listed, errs, answers)


def drawn(row: Row, settings: GuardSettings, count: int, seed: int) -> Brackets:
    """Brackets of a row."""
    rng = np.random.default_rng([seed, row.goals])
    product = with_goals(load_product(load_configuration()), row.goals)
    layout = Layout.of(product)
    confusions = Confusions.of(layout, "uniform", DETECTION_ERROR if row.errs else 0.0)
    known = OpenGoals.of(product, load_configuration().planners.semantic.new_goals)
    planner, guard = BayesPlanner(product, known), Guard(product, settings)
    of = layout.types[rng.integers(len(layout.types), size=count)] if row.listed else ()
    brackets = list(of) if row.listed else unlisted(layout, count, rng, repeated=True)
    return [assemble(planner, guard, types, confusions, rng, answers=row.answers) for types in brackets]


def with_goals(product: Product, count: int) -> Product:
    """The product with so many goals: its own, and other arrangements of its parts."""
    bag = [name for name, part in product.parts.items() for _ in range(part.quantity)]
    every = [permutation for permutation in sorted(set(permutations(bag))) if permutation not in product.goals.values()]
    more = np.random.default_rng(5).permutation(len(every))[: count - len(product.goals)]
    goals = {**product.goals, **{f"more{number}": every[number] for number in more}}
    return Product.model_validate({**product.model_dump(), "goals": goals})


def told(row: Row, brackets: Brackets) -> str:
    """A line of the table."""
    states = [state for bracket in brackets for state in bracket]
    acts = [state["wrong"] for state in states if state["acts"]]
    first = [next((n for n, state in enumerate(bracket, 1) if state["acts"]), len(bracket) + 1) for bracket in brackets]
    shares = (
        (sum(acts), len(acts)),
        (sum(any(state["wrong"] for state in bracket) for bracket in brackets), len(brackets)),
        (sum(any(state["asked"] for state in bracket) for bracket in brackets), len(brackets)),
    )
    cells = " | ".join(_share(*pair) for pair in shares)
    words = f"{row.goals:5} {'listed' if row.listed else 'unlisted':8} {'4.5 %' if row.errs else 'true':7}"
    acted = len(acts) / len(states)
    return f"{words} {'yes' if row.answers else 'nobody':7} | {cells} | {acted:.2f} | {np.mean(first):.2f}"


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
    planner: BayesPlanner,
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
            state = state.with_goal(next((goal for goal, row in known if row == types.tolist()), UNKNOWN_GOAL))
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


def _share(some: int, count: int) -> str:
    low, _, high = wilson(some, count)
    return f"{some / max(count, 1):.3f} ({low:.3f} - {high:.3f}, n {count})"


if __name__ == "__main__":
    main()
