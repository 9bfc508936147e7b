"""What the person is told to build, one bracket after the other; some of it nobody has listed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import cycle

import numpy as np

from bracket_ground.errors import InputError
from bracket_ground.interfaces.product import Product
from bracket_ground.interfaces.variants import EMPTY

RANDOM_GOAL = "random"
NOT_LISTED = "not listed"
TRIES = 1000


@dataclass(frozen=True)
class Job:
    """One bracket: the goal's name, and the part type at every position."""

    goal: str
    placements: Mapping[str, str]


class Jobs:
    """Draws the jobs of a shift.

    Args:
        goal: every bracket's, or several by commas that take turns; "random" draws one for each.
        new_goals: share of the brackets of a random shift that have an arrangement which the product does not list; it
            is the same one all through the shift, so that it can be learned.
    """

    def __init__(self, product: Product, goal: str, new_goals: float, rng: np.random.Generator) -> None:
        self._product, self._goal, self._new_goals, self._rng = product, goal, new_goals, rng
        self._turns = cycle(goal.split(","))
        self._unlisted = _unlisted(product, rng) if goal == RANDOM_GOAL and new_goals > 0 else None

    def next(self) -> Job:
        """The next bracket's job."""
        product = self._product
        if self._unlisted is not None and self._rng.random() < self._new_goals:
            return Job(NOT_LISTED, self._unlisted)
        goal = chosen_goal(product, next(self._turns), self._rng)
        return Job(goal, product.goal_placements(goal))


def chosen_goal(product: Product, goal: str, rng: np.random.Generator) -> str:
    """The goal that was asked for, or a drawn one.

    Raises:
        InputError: the product has none of this name.
    """
    names = sorted(product.goals)
    if goal == RANDOM_GOAL:
        return names[int(rng.integers(len(names)))]
    if goal not in product.goals:
        raise InputError(f"unknown goal {goal!r}; legal: {', '.join([*names, RANDOM_GOAL])}")
    return goal


def _unlisted(product: Product, rng: np.random.Generator) -> Mapping[str, str] | None:
    """An arrangement of the product's parts that is none of its goals; None where every one is."""
    goals = list(product.goals)
    for _ in range(TRIES):
        goal = goals[0] if len(goals) == 1 or not product.varies else goals[int(rng.integers(len(goals)))]
        parts = sorted(product.as_listed(product.goal_placements(goal)), key=[*product.parts, EMPTY].index)
        drawn = tuple(parts[index] for index in rng.permutation(len(parts)))
        there = {at: part for at, part in zip(product.positions, drawn, strict=True) if part != EMPTY}
        fits = all(part in product.accepts.get(at, (part,)) for at, part in there.items())
        if fits and not any(product.fits(listed, there) for listed in goals):
            return there
    return None
