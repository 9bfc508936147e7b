"""Exact posterior over goals under a noise model: what a learned planner is measured against and guarded by."""

from __future__ import annotations

from math import comb, factorial, perm, prod

import numpy as np

from learned.semantic.graph import Floats, Layout
from learned.semantic.scenarios import DETECTION_ERROR, action_pairs

UNKNOWN_PRIOR = 0.05  # how often somebody builds what was never demonstrated


class BayesPosterior:
    """P(goal | edges) with equal priors for the z goals and a small one for "none of these".

    Any k of the goal's m slots are done, all choices alike. Each is reported right with probability
    a = 1 - error, or as one given other (type, position) with probability q = error / (pairs - 1). Summed over
    which slot each of the k reports stems from, a goal that agrees with c of them has the likelihood

        L(c, k) = sum_i C(c, i) (a - q)^i q^(k - i) (m - i)! / (m - k)!

    up to a factor that is the same for all goals: i reports are fixed to their own slots, the others are free.
    """

    def __init__(self, layout: Layout, error: float = DETECTION_ERROR, unknown: float = UNKNOWN_PRIOR) -> None:
        self._layout = layout
        self._unknown = unknown
        wrong = error / max(len(action_pairs(layout)) - 1, 1)
        right = 1.0 - error - wrong
        m = len(layout.positions)
        self._terms = [
            [right**i * wrong ** (k - i) * factorial(m - i) / factorial(m - k) for i in range(k + 1)]
            for k in range(m + 1)
        ]
        self._likelihood = np.array(
            [
                [sum(comb(c, i) * term for i, term in enumerate(self._terms[k])) for k in range(m + 1)]
                for c in range(m + 1)
            ]
        )

    def __call__(self, edges: Floats) -> Floats:
        """Posterior (z + 1,) of the goals and of none of them, for the edges (n, m)."""
        filled = int(edges.sum())
        agreeing = np.tensordot(self._layout.wanted, edges, 2).astype(int)
        likelihood = self._likelihood[agreeing, filled]
        known = (1.0 - self._unknown) * likelihood / len(likelihood)
        unknown = self._unknown * self._unknown_likelihood(edges, likelihood)
        joint = np.append(known, unknown)
        posterior: Floats = (joint / joint.sum()).astype(np.float32)
        return posterior

    def _unknown_likelihood(self, edges: Floats, likelihood: np.ndarray) -> float:
        """Mean of L over all arrangements of the same parts that are no goal.

        The mean over all arrangements needs no list of them: it asks only for the expected number of i-subsets
        of the reports that an arrangement agrees with, the coefficients of a product of polynomials.
        """
        quantities = self._layout.quantities.tolist()
        arrangements = factorial(sum(quantities)) // prod(factorial(count) for count in quantities)
        if arrangements == len(likelihood):
            return 0.0
        subsets: Floats = np.ones(1)
        for quantity, reported in zip(quantities, edges.sum(axis=1).astype(int).tolist(), strict=True):
            subsets = np.convolve(subsets, [comb(reported, i) * perm(quantity, i) for i in range(reported + 1)])
        m = edges.shape[1]
        terms = self._terms[len(subsets) - 1]
        mean = sum(term * count / perm(m, i) for i, (term, count) in enumerate(zip(terms, subsets, strict=True)))
        rest = arrangements * float(mean) - float(likelihood.sum())
        return max(rest, 0.0) / (arrangements - len(likelihood))
