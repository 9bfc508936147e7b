"""Posterior of goals, of "none of these", and of the placements that remain, from likelihoods of what was reported."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import comb, factorial, perm, prod

import numpy as np

from cell.errors import ModelError
from learned.semantic.graph import Floats, Layout
from learned.semantic.noise import Noise

UNKNOWN_PRIOR = 0.02  # how often somebody builds what was never demonstrated
CACHED = 4096  # combinations of reported quantities that are kept


@dataclass(frozen=True)
class Posterior:
    """What the reports say.

    Attributes:
        belief: (z + 1,) probability of every goal, and of none of them.
        placements: (n, m) probability that a type is right at a position and that the position is truly open; zero
            where it is seen to be filled.
    """

    belief: Floats
    placements: Floats


@dataclass(frozen=True)
class Likelihood:
    """P(reports | goal) for every goal.

    Attributes:
        goals: (z,) of the reports.
        still_open: (z, m) of the reports together with this position being truly open; read where it is seen open.
        wanted: (z, n, m) probability that a goal wants a type at a position.
        prior: (z,) of the goals, given that it is one of them.
        usual: how much likelier the filled positions are by everybody's habits than by chance.
    """

    goals: Floats
    still_open: Floats
    wanted: Floats
    prior: Floats
    usual: float = 1.0


class UnknownGoal:
    """P(reports | an arrangement of the same parts that is no goal), the arrangements all alike.

    The mean over all arrangements needs no list of them: it asks only for the expected number of i-subsets of the
    reports that an arrangement agrees with, coefficients of a product of polynomials, one of each type.
    """

    def __init__(self, layout: Layout, noise: Noise) -> None:
        self._quantities: list[int] = layout.quantities.tolist()
        self._m = len(layout.positions)
        self._terms = noise.terms()
        self._open_terms = noise.terms(one_open=True)
        arrangements = factorial(self._m) // prod(factorial(count) for count in self._quantities)
        others = arrangements - len(layout.goals)
        self.possible = others > 0
        self.all_share = arrangements / others if others else 1.0
        self.goal_share = 1.0 / others if others else 0.0
        self.mean = lru_cache(maxsize=CACHED)(self._mean)

    def _mean(self, reported: tuple[int, ...]) -> tuple[float, Floats]:
        """Mean likelihood over all arrangements, from the number of reports by type.

        Returns:
            Of the reports, and (n,) of the reports together with a certain open slot that holds this type.
        """
        k, m = sum(reported), self._m
        everything = self._expected(reported, self._quantities, m)
        size = len(everything)
        total = float(self._terms[k, :size] @ everything)
        still_open = np.zeros(len(reported))
        for part, quantity in enumerate(self._quantities):
            left = [count - (other == part) for other, count in enumerate(self._quantities)]
            subsets = self._expected(reported, left, m - 1)
            still_open[part] = quantity / m * float(self._open_terms[k, : len(subsets)] @ subsets)
        return total, still_open

    def _expected(self, reported: tuple[int, ...], quantities: list[int], slots: int) -> Floats:
        """Expected number of i-subsets of the reports that agree with a random arrangement, i = 0, 1, ..."""
        counts: Floats = np.ones(1)
        for quantity, reports in zip(quantities, reported, strict=True):
            counts = np.convolve(counts, [comb(reports, i) * perm(quantity, i) for i in range(reports + 1)])
        counts = counts[: slots + 1]
        return counts / [perm(slots, i) for i in range(len(counts))]


def posterior(
    edges: Floats,
    likelihood: Likelihood,
    unknown: UnknownGoal,
    prior: float = UNKNOWN_PRIOR,
    alike: Likelihood | None = None,
) -> Posterior:
    """Posterior for the edges (n, m).

    Args:
        prior: of "none of these".
        alike: the goals' likelihood under the noise that `unknown` has, where `likelihood` is under another.

    Raises:
        ModelError: the likelihoods are no numbers, or all zero.
    """
    still = 1.0 - edges.any(axis=0)
    known = (1.0 - prior if unknown.possible else 1.0) * likelihood.prior
    goals = known * likelihood.goals
    placements = np.einsum("g,gm,gnm->nm", known, likelihood.still_open, likelihood.wanted)
    none = 0.0
    if unknown.possible:
        mean, open_mean = unknown.mean(tuple(edges.sum(axis=1).astype(int).tolist()))
        scale = prior * likelihood.usual
        alike = alike or likelihood
        none = scale * max(unknown.all_share * mean - unknown.goal_share * float(alike.goals.sum()), 0.0)
        of_goals = np.einsum("gm,gnm->nm", alike.still_open, alike.wanted)
        placements += scale * np.maximum(unknown.all_share * open_mean[:, None] - unknown.goal_share * of_goals, 0.0)
    joint = np.append(goals, none)
    total = float(joint.sum())
    if not (np.isfinite(total) and total > 0.0):
        raise ModelError(f"likelihoods of the goals are {likelihood.goals.tolist()}, no posterior follows from them")
    return Posterior(joint / total, placements / np.maximum(placements.sum(axis=0), 1e-300) * still)
