"""Exact posterior over goals under a noise model: what a learned planner is measured against and guarded by."""

from __future__ import annotations

from math import comb

import numpy as np

from learned.semantic.graph import Floats, Layout
from learned.semantic.noise import Noise
from learned.semantic.posterior import UNKNOWN_PRIOR, Likelihood, Posterior, UnknownGoal, posterior
from learned.semantic.scenarios import DETECTION_ERROR


class BayesPosterior:
    """Equal priors for the z goals, a small one for "none of these", and people without habits of order.

    Any k of the goal's m slots are done, all choices alike. Summed over which slot each of the k reports stems from,
    a goal that agrees with c of them has the likelihood

        L(c, k) = sum_i C(c, i) (a - q)^i q^(k - i) (k - i)! C(m - i, k - i) / C(m, k),

    a the probability that a placement is reported right and q that it is reported as one given other: i reports are
    fixed to their own slots, the others are free.
    """

    def __init__(self, layout: Layout, error: float = DETECTION_ERROR, unknown: float = UNKNOWN_PRIOR) -> None:
        noise = Noise.of(layout, error)
        self._layout = layout
        self._prior = unknown
        self._unknown = UnknownGoal(layout, noise)
        subsets = np.array([[comb(c, i) for i in range(noise.wrong.size)] for c in range(noise.wrong.size)])
        self._likelihood = subsets @ noise.terms().T
        self._open_likelihood = subsets @ noise.terms(one_open=True).T
        self._equal = np.full(len(layout.goals), 1.0 / len(layout.goals))

    def __call__(self, edges: Floats) -> Posterior:
        """Posterior for the edges (n, m)."""
        filled = int(edges.sum())
        agreeing = np.tensordot(self._layout.wanted, edges, 2).astype(int)
        still_open = np.repeat(self._open_likelihood[agreeing, filled][:, None], edges.shape[1], axis=1)
        likelihood = Likelihood(self._likelihood[agreeing, filled], still_open, self._layout.wanted, prior=self._equal)
        return posterior(edges, likelihood, self._unknown, self._prior)
