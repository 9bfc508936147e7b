"""Guaranteed thresholds: at most a given share of wrong acts, with a given confidence, from recorded runs.

Learn then test (Angelopoulos and others, 2021) with thresholds tested in a fixed order, strictest first: each is
certified while the binomial tail of its wrong acts rejects "more acts than the limit are wrong". One state of each run
counts, so that cases are independent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb

import numpy as np

from bracket_ground.interfaces.planning import AssemblyState, SemanticPlanner
from bracket_ground.interfaces.product import Product

THRESHOLDS = tuple(float(value) for value in np.round(np.arange(0.995, 0.495, -0.005), 3))  # strictest first
CONFIDENCE = 0.9


@dataclass(frozen=True)
class Case:
    """One state of one run: how sure the best placement was, and whether it was wrong."""

    belief: float
    wrong: bool


@dataclass(frozen=True)
class Certificate:
    """What holds with CONFIDENCE.

    Attributes:
        limit: share of wrong acts.
        threshold: lowest belief at which the robot may act; None where no threshold could be certified.
        coverage: share of states in which it acts then.
        runs: number of runs that it rests on.
        acts, wrong: of these, states with an act and with a wrong one.
    """

    limit: float
    threshold: float | None
    coverage: float
    runs: int
    acts: int
    wrong: int


def certificate(cases: Sequence[Case], limit: float) -> Certificate:
    """The lowest threshold that is certified."""
    found = Certificate(limit, None, 0.0, len(cases), 0, 0)
    for threshold in THRESHOLDS:
        acts = [case for case in cases if case.belief >= threshold]
        wrong = sum(case.wrong for case in acts)
        if not acts and threshold > THRESHOLDS[-1]:
            continue
        if binomial_tail(wrong, len(acts), limit) > 1.0 - CONFIDENCE:
            break
        found = Certificate(limit, threshold, len(acts) / len(cases), len(cases), len(acts), wrong)
    return found


def least_limit(cases: Sequence[Case], threshold: float) -> float:
    """The smallest share of wrong acts that can be certified for one threshold that was chosen beforehand."""
    acts = [case for case in cases if case.belief >= threshold]
    wrong = sum(case.wrong for case in acts)
    low, high = 0.0, 1.0
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (middle, high) if binomial_tail(wrong, len(acts), middle) > 1.0 - CONFIDENCE else (low, middle)
    return high


def binomial_tail(wrong: int, count: int, limit: float) -> float:
    """Probability of at most that many wrong acts of `count` where each is wrong with probability `limit`."""
    return sum(comb(count, k) * limit**k * (1.0 - limit) ** (count - k) for k in range(wrong + 1))


def case_of(planner: SemanticPlanner, product: Product, state: AssemblyState, final: Sequence[str]) -> Case:
    """What the planner would have done in a state of a run that ended so; the state says which holes are open."""
    plan = planner.plan(state)
    (part, position), belief = max(plan.next_belief.items(), key=lambda item: item[1], default=(("", ""), 0.0))
    return Case(belief, bool(position) and final[product.positions.index(position)] != part)
