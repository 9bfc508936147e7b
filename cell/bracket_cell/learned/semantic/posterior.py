"""Posterior of goals, of "none of these", and of the placements that remain, from likelihoods of what was reported."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import comb, factorial, perm, prod

import numpy as np

from bracket_cell.learned.semantic.confusions import MOST_POSITIONS, ConfusionLikelihood, Confusions
from bracket_cell.learned.semantic.graph import Floats, Layout, action_pairs
from bracket_cell.learned.semantic.settings import DETECTION_ERROR
from bracket_ground.errors import ModelError


@dataclass(frozen=True, eq=False)
class Noise:
    """Rates of reports by the number k of reports, k = 0..m.

    With probability `error` an action is taken for another of the actions that the detector knows, all alike, at a
    position that is seen as open: of the (type, position) pairs of m positions, those of m - k + 1 are left.

    Attributes:
        wrong: (m + 1,) probability q that a placement is reported as one given other.
        excess: (m + 1,) by how much the probability that it is reported right exceeds q.
    """

    wrong: Floats
    excess: Floats

    @staticmethod
    def of(layout: Layout, error: float = DETECTION_ERROR) -> Noise:
        """Noise of a detector that knows the actions of the demonstrated goals."""
        m = len(layout.positions)
        others = len(action_pairs(layout)) * (m - np.arange(m + 1) + 1) / m - 1.0
        wrong = error / np.maximum(others, 1.0)
        return Noise(wrong, np.maximum(1.0 - error - wrong, 0.0))

    def terms(self, *, one_open: bool = False) -> Floats:
        """(k, i) probability of k reports of which i certain ones are right, the others stemming from any slots.

        Any k of m slots are done, all choices alike; summed over the C(m - i, k - i) (k - i)! ways in which the
        other reports may stem from the slots left.

        Args:
            one_open: only those ways that leave one certain slot open.
        """
        m = len(self.wrong) - 1
        slots = m - 1 if one_open else m
        table = np.zeros((m + 1, m + 1))
        for k in range(m + 1):
            for i in range(min(k, slots) + 1):
                ways = comb(slots - i, k - i) * factorial(k - i) / comb(m, k)
                table[k, i] = self.excess[k] ** i * self.wrong[k] ** (k - i) * ways
        return table


UNKNOWN_PRIOR = 0.02  # how often somebody builds what was never demonstrated
CACHED = 4096  # combinations of reported quantities that are kept


@dataclass(frozen=True, eq=False)
class Posterior:
    """What the reports say.

    Attributes:
        belief: (z + 1,) probability of every goal, and of none of them.
        placements: (n, m) probability that a type is right at a position and that the position is truly open; zero
            where it is seen to be filled.
    """

    belief: Floats
    placements: Floats


@dataclass(frozen=True, eq=False)
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


class UniformLikelihood:
    """P(reports | goal) where any action is taken for any other alike, for people without habits of order.

    Any k of the goal's m slots are done, all choices alike. Summed over which slot each of the k reports stems from,
    a goal that agrees with c of them has the likelihood

        L(c, k) = sum_i C(c, i) (a - q)^i q^(k - i) (k - i)! C(m - i, k - i) / C(m, k),

    a the probability that a placement is reported right and q that it is reported as one given other: i reports are
    fixed to their own slots, the others are free.
    """

    def __init__(self, layout: Layout, noise: Noise) -> None:
        self._wanted = layout.wanted
        subsets = np.array([[comb(c, i) for i in range(noise.wrong.size)] for c in range(noise.wrong.size)])
        self._likelihood = subsets @ noise.terms().T
        self._open_likelihood = subsets @ noise.terms(one_open=True).T

    def __call__(self, edges: Floats) -> tuple[Floats, Floats]:
        """Likelihood (z,) of the edges (n, m), and (z, m) that together with each slot being open."""
        filled = int(edges.sum())
        agreeing = np.tensordot(self._wanted, edges, 2).astype(int)
        still_open = np.repeat(self._open_likelihood[agreeing, filled][:, None], edges.shape[1], axis=1)
        return self._likelihood[agreeing, filled], still_open


class BayesPosterior:
    """The posterior of z goals and of none of them."""

    def __init__(
        self,
        layout: Layout,
        error: float = DETECTION_ERROR,
        unknown: float = UNKNOWN_PRIOR,
        *,
        prior: Floats | None = None,
        confusions: Confusions | None = None,
    ) -> None:
        """Args:
        error: share of wrong reports, where no confusions are known.
        unknown: prior of none of the goals.
        prior: (z,) of the goals, given that it is one of them; all alike by default.
        confusions: what is taken for what.
        """
        noise = Noise.of(layout, error if confusions is None else max(confusions.error, 1e-6))
        self._wanted = layout.wanted
        self._none = unknown
        self._unknown = UnknownGoal(layout, noise)
        self._prior = np.full(len(layout.goals), 1.0 / len(layout.goals)) if prior is None else prior
        self._uniform = UniformLikelihood(layout, noise)
        counted = confusions is not None and len(layout.positions) <= MOST_POSITIONS
        self._counted = ConfusionLikelihood(layout, confusions) if counted and confusions else None

    def __call__(self, edges: Floats, seen: Floats | None = None) -> Posterior:
        """Posterior for the edges (n, m).

        Args:
            seen: (n, m) the edges with the detector's doubts; counts where confusions are known.
        """
        usual = Likelihood(*self._uniform(edges), self._wanted, self._prior)
        if self._counted is None:
            return posterior(edges, usual, self._unknown, self._none)
        return posterior(
            edges,
            Likelihood(*self._counted(edges if seen is None else seen), self._wanted, self._prior),
            self._unknown,
            self._none,
            usual,
        )
