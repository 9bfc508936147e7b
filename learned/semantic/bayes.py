"""Exact posterior over goals under a noise model: what a learned planner is measured against and guarded by."""

from __future__ import annotations

from math import comb

import numpy as np

from learned.semantic.confusions import MOST_POSITIONS, ConfusionLikelihood, Confusions
from learned.semantic.graph import Floats, Layout
from learned.semantic.noise import Noise
from learned.semantic.posterior import UNKNOWN_PRIOR, Likelihood, Posterior, UnknownGoal, posterior
from learned.semantic.scenarios import DETECTION_ERROR


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
