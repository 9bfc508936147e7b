"""What the goals of a family may look like: arrangements of parts, each of one goal.

A goal whose slots take one type each, or alternatives that no quantity limits, is one hypothesis: its slots are
independent. A goal with quantities of its own is the list of its arrangements, as far as these are few.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import comb, factorial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bracket_ground.interfaces.variants import EMPTY, Choice, arrangements, arrangements_n, types_of


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


MOST_ROWS = 600  # arrangements that one goal is listed as: a plan of them takes some 3 ms
MOST_TRIED = 20_000  # combinations of alternatives that are looked through for these

Ints = NDArray[np.int64]
Floats = NDArray[np.floating[Any]]


@dataclass(frozen=True, eq=False)
class Hypotheses:
    """Arrangements by index; r of them, n part types, m slots.

    Attributes:
        goal: (r,) which goal each is of, in the order of the goals.
        shares: (r, n + 1, m) how probable each type is in a slot; the last: that it stays empty.
        averaged: names of goals whose quantities do not count, as they leave too many arrangements open.
    """

    goal: Ints
    shares: Floats
    averaged: tuple[str, ...] = ()

    @staticmethod
    def of(
        parts: Sequence[str], goals: Mapping[str, Sequence[Choice]], limits: Mapping[str, Mapping[str, int]]
    ) -> Hypotheses:
        """Of goals with what every slot takes, and with how many parts of a type a goal takes at most."""
        numbers = {part: number for number, part in enumerate((*parts, EMPTY))}
        rows: list[Floats] = []
        owners: list[int] = []
        averaged = []
        for number, (goal, choices) in enumerate(goals.items()):
            listed: list[Sequence[Choice]] = [choices]
            if limits.get(goal) and any(len(types_of(choice)) > 1 for choice in choices):
                few = arrangements_n(choices) <= MOST_TRIED
                found = arrangements(choices, limits[goal], MOST_ROWS + 1) if few else []
                if 0 < len(found) <= MOST_ROWS:
                    listed = list(found)
                else:
                    averaged.append(goal)
            rows += [_shares(arrangement, numbers) for arrangement in listed]
            owners += [number] * len(listed)
        return Hypotheses(np.array(owners), np.array(rows), tuple(averaged))

    @cached_property
    def slots(self) -> Ints:
        """(r,) how many slots each fills."""
        filled: Ints = (self.empty < 1.0).sum(axis=1)
        return filled

    @cached_property
    def empty(self) -> Floats:
        """(r, m) one where a slot stays empty."""
        return self.shares[:, -1]

    @cached_property
    def wanted(self) -> Floats:
        """(r, n, m) shares of the types."""
        return self.shares[:, :-1]

    @cached_property
    def accepted(self) -> Floats:
        """(r, n, m) one where a type is right."""
        right: Floats = (self.wanted > 0).astype(float)
        return right

    @cached_property
    def listed_n(self) -> Ints:
        """(r,) of how many hypotheses the goal of each is made."""
        return np.bincount(self.goal)[self.goal]

    @cached_property
    def plain(self) -> bool:
        """Whether each is a goal, and every slot takes one type."""
        return len(self.goal) == self.goal.max() + 1 and bool((self.wanted.max(axis=1) == 1.0).all())

    @cached_property
    def bags(self) -> Counter[tuple[int, ...]]:
        """How many of those without alternatives take so many of each type, and of none."""
        sure = self.shares.max(axis=1).min(axis=1) == 1.0
        return Counter(tuple(row) for row in self.shares[sure].sum(axis=2).astype(int).tolist())

    def bag_of(self) -> list[tuple[int, ...]]:
        """Of each how many parts of each type it takes; without meaning where there are alternatives."""
        return [tuple(row) for row in self.shares.sum(axis=2).astype(int).tolist()]

    def right(self, edges: Floats) -> Floats:
        """(r, n, m) one where a type is right for the goal, some arrangement of it agreeing with what is placed.

        Args:
            edges: (n, m) what is placed.
        """
        right = self.accepted
        if (self.listed_n == 1).all():
            return right
        right, agreeing = right.copy(), np.tensordot(self.accepted, edges, 2)
        for goal in np.unique(self.goal[self.listed_n > 1]):
            rows = np.flatnonzero(self.goal == goal)
            best = rows[agreeing[rows] == agreeing[rows].max()]
            right[rows] = self.accepted[best].max(axis=0)
        return right


def _shares(choices: Sequence[Choice], numbers: Mapping[str, int]) -> Floats:
    shares = np.zeros((len(numbers), len(choices)))
    for slot, choice in enumerate(choices):
        types = types_of(choice) or (EMPTY,)
        for part in types:
            shares[numbers[part], slot] += 1.0 / len(types)
    return shares
