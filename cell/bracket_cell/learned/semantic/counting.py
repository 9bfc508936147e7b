"""Ways in which reports may stem from the slots of a goal, counted without listing them."""

from __future__ import annotations

from math import comb, factorial

import numpy as np

from bracket_cell.learned.semantic.hypotheses import Floats, Hypotheses, Ints


def ways(size: int, filled: int, *, one_open: bool = False) -> Floats:
    """(size, size) in how many ways k reports stem from a goal's slots, i certain ones from their own.

    The other k - i stem from any slots that are left; over the C(filled, k) choices of slots that are done.

    Args:
        filled: how many slots the goal fills; zero for more reports than that.
        one_open: only those ways that leave one certain slot open.
    """
    table = np.zeros((size, size))
    slots = filled - 1 if one_open else filled
    for k in range(min(filled, size - 1) + 1):
        for i in range(min(k, slots) + 1):
            table[k, i] = comb(slots - i, k - i) * factorial(k - i) / comb(filled, k)
    return table


def agreeing_subsets(right: Floats, wrong: Floats) -> Floats:
    """(z, k + 1) sums over i-subsets of k reports: the product of `right` (z, k) in it and of `wrong` of the others."""
    sums = np.zeros((right.shape[1] + 1, len(right)))
    sums[0] = 1.0
    for report, (own, other) in enumerate(zip(right.T.copy(), wrong.T.copy(), strict=True)):
        taken = sums[: report + 1] * own
        sums[: report + 1] *= other
        sums[1 : report + 2] += taken
    return sums.T


def weighed(subsets: Floats, terms: Floats, open_terms: Floats, size: Ints, some: Hypotheses) -> tuple[Floats, Floats]:
    """Likelihood (z,) from sums over subsets (z, k + 1), and (z, m) that together with each slot being open.

    Args:
        terms, open_terms: (sizes, m + 1, m + 1) weights by the number of filled slots, k and i.
        size: (z,) which of the sizes each is of.
    """
    k = subsets.shape[1] - 1
    whole: Floats = (subsets * terms[size, k, : k + 1]).sum(axis=1)
    still_open = (subsets * open_terms[size, k, : k + 1]).sum(axis=1)
    return whole, np.where(some.empty == 1.0, whole[:, None], still_open[:, None])
