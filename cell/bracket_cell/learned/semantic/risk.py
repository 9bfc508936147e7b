"""From which probability on the robot may act, so that few of its acts are wrong by what the planner itself expects.

A threshold alone does not say how many acts are wrong: with three goals most acts are near certain, with twelve many
are just above it. So states are drawn as the planner believes that they come: goals as probable as it takes them, new
arrangements among them, actions mistaken as its confusions say. Its belief in the best placement of such a state is the
probability that the act is right; the threshold is where the mean of the rest still keeps the share.
"""

from __future__ import annotations

import numpy as np

from bracket_cell.learned.semantic.confusions import Confusions
from bracket_cell.learned.semantic.goals import OpenGoals
from bracket_cell.learned.semantic.graph import EMPTY, Floats, Ints, Layout
from bracket_cell.learned.semantic.misdetection import Scenarios, misdetect
from bracket_cell.learned.semantic.model import BayesPlanner, FactoredPlanner
from bracket_ground.interfaces.planning import UNKNOWN_GOAL

STATES = 90  # drawn states: some 30 ms
NONE_OF_THESE = 0.5  # from this belief on the robot asks instead of acting


def act_probability(
    planner: BayesPlanner | FactoredPlanner,
    goals: OpenGoals,
    confusions: Confusions | None,
    least: float,
    wrong_share: float,
) -> float:
    """The least belief, `least` or more, from which on at most `wrong_share` of the acts are expected to be wrong.

    Where the product's own goals alone are known that is `least`. The same goals give the same answer.
    """
    if not goals.learned or wrong_share >= 1.0:
        return least
    beliefs = np.sort([belief for belief in _beliefs(planner, goals, confusions) if belief >= least])[::-1]
    if not len(beliefs):
        return least
    expected: Floats = np.cumsum(1.0 - beliefs) / np.arange(1, len(beliefs) + 1)
    kept = int(np.searchsorted(expected, wrong_share, side="right"))  # the means rise, as the beliefs fall
    if kept == len(beliefs):
        return least
    return round(float(beliefs[max(kept - 1, 0)]), 4)


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


def _beliefs(planner: BayesPlanner | FactoredPlanner, goals: OpenGoals, confusions: Confusions | None) -> list[float]:
    """The belief in the best placement of each drawn state."""
    layout, rng, found = planner.layout, np.random.default_rng(0), []
    parts = np.repeat(np.arange(len(layout.parts)), layout.quantities)
    m = len(layout.positions)
    reached = np.cumsum(goals.prior())
    for number in range(STATES):
        goal = int(np.searchsorted(reached, (number + 0.5) / STATES))
        types = layout.types[goal] if goal < len(layout.goals) else rng.permutation(parts)
        done = rng.permutation(m)[: 1 + number % (m - 1)]
        true, seen = seen_after(layout, types, done, confusions, rng)
        plan = planner.plan(layout.state(seen))
        if plan.goal_belief[UNKNOWN_GOAL] < NONE_OF_THESE:
            still = {name for name, part in zip(layout.positions, true.tolist(), strict=True) if part == EMPTY}
            found.append(max((value for (_, at), value in plan.next_belief.items() if at in still), default=0.0))
    return found
