"""The noise model: an action is reported right, or as another action at a position that is still open."""

from __future__ import annotations

from dataclasses import dataclass
from math import comb, factorial

import numpy as np

from learned.semantic.graph import Floats, Layout
from learned.semantic.scenarios import DETECTION_ERROR, action_pairs


@dataclass(frozen=True)
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
