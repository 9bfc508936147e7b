"""P(reports | goal) under confusions where the sets of slots are too many to be listed.

A report's chance from its own slot counts as it is; its chances from other slots count by their mean:

    L = sum over the sets S of reports  prod_{r in S} (own_r - mean_r)  prod_{r not in S} mean_r  ways(k, |S|)

which is exact where every other slot gives the report with one chance, none among them.
"""

from __future__ import annotations

import numpy as np

from bracket_cell.learned.semantic.confusions import ConfusionLikelihood, Confusions, Reports
from bracket_cell.learned.semantic.counting import agreeing_subsets, ways, weighed
from bracket_cell.learned.semantic.graph import Floats, Layout

MOST_STATES = 40_000  # sets of slots times slots times arrangements that are counted one by one: some 3 ms


def confusion_likelihood(layout: Layout, confusions: Confusions) -> ConfusionLikelihood | FactoredConfusions:
    """Exact where that takes a few milliseconds."""
    m = len(layout.positions)
    listed = 2**m * m * len(layout.hypotheses.goal) <= MOST_STATES
    return ConfusionLikelihood(layout, confusions) if listed else FactoredConfusions(layout, confusions)


class FactoredConfusions:
    """P(reports | goal) in a time that grows with slots times reports.

    Attributes:
        approximate: what is approximate, and why; empty where it is exact.
    """

    def __init__(self, layout: Layout, confusions: Confusions) -> None:
        some, m = layout.hypotheses, len(layout.positions)
        self._some, self._m = some, m
        self._reports = Reports(confusions, m)
        self._wanted = some.wanted.reshape(len(some.goal), -1)
        sizes, self._size = np.unique(some.slots, return_inverse=True)
        self._terms = np.array([ways(m + 1, int(size)) for size in sizes])
        self._open_terms = np.array([ways(m + 1, int(size), one_open=True) for size in sizes])
        place = np.arange(len(confusions.matrix)) % m
        moved = bool((confusions.matrix[place[:, None] != place] > 0).any())
        self.approximate = f"confusions between {m} slots count by their mean" if moved else ""

    def __call__(self, edges: Floats) -> tuple[Floats, Floats]:
        """Likelihood (z,) of the edges (n, m), and (z, m) that together with each slot being open.

        Args:
            edges: 1 for what was reported; where the detector was in doubt, the shares of the parts at that position.
        """
        places, chances = self._reports.chances(edges.astype(float))
        every = self._wanted @ chances.T
        own = np.empty_like(every)
        for number, place in enumerate(places.tolist()):
            at = chances[number].reshape(-1, self._m)[:, place]
            own[:, number] = self._some.wanted[:, :, place] @ at
        others = self._some.slots[:, None] - 1 + self._some.empty[:, places]
        mean = np.maximum(every - own, 0.0) / np.maximum(others, 1)
        subsets = agreeing_subsets(own - mean, mean)
        whole, still_open = weighed(subsets, self._terms, self._open_terms, self._size, self._some)
        return np.maximum(whole, 0.0), np.maximum(still_open, 0.0)
