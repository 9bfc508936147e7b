"""What no planner can beat: the exact joint distribution of goals and reports, by enumeration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import comb

import numpy as np

from bracket_cell.learned.semantic.graph import EMPTY, Bools, Floats, Ints, Layout, action_pairs
from bracket_lab.experiments.semantic_demonstrators import set_probabilities
from bracket_lab.learned.semantic.scenarios import Demonstrators

LEAST = 1e-12  # less probable reports are left out


@dataclass(frozen=True, eq=False)
class Joint:
    """P(goal, reports) over everything that can be reported.

    Attributes:
        seen: (R, m) rows of part types, EMPTY where nothing is reported.
        taken: (R, m) holes that count as filled: those reported, or those that a camera sees filled.
        goals: (R, z) probability of the row together with each goal; sums to 1.
    """

    layout: Layout
    seen: Ints
    taken: Bools
    goals: Floats

    @property
    def weights(self) -> Floats:
        """(R,) probability of every row."""
        total: Floats = self.goals.sum(axis=1)
        return total

    def goal_accuracy(self) -> float:
        """Of naming the most probable goal."""
        return float(self.goals.max(axis=1).sum())

    def goal_nll(self) -> float:
        """Mean negative log-likelihood of the true goal under the exact posterior [nat]."""
        some = self.goals > 0
        posterior = self.goals / self.weights[:, None]
        return float(-(self.goals[some] * np.log(posterior[some])).sum())

    def next_beliefs(self) -> Floats:
        """(R, n, m) exact probability that a type is right at a position; zero where the hole is taken."""
        placements = np.einsum("rg,gnm->rnm", self.goals, self.layout.wanted) / self.weights[:, None, None]
        still: Floats = placements * ~self.taken[:, None, :]
        return still


def exact_joint(
    layout: Layout, states: Mapping[tuple[int, ...], Floats], error: float, *, holes_seen: bool = False
) -> Joint:
    """The joint distribution from that of the true states.

    Args:
        states: by filled position (ones and zeros), (z,) probability of the state and each goal; sums to 1.
        error: share of misdetections, as `bracket_lab.learned.semantic.scenarios.misdetect` makes them.
        holes_seen: a camera sees which holes are filled, not with what: reports of open holes are dropped.
    """
    rows: dict[tuple[tuple[int, ...], tuple[bool, ...]], Floats] = {}
    pairs = action_pairs(layout)
    for mask, probabilities in states.items():
        for goal, probability in enumerate(probabilities):
            types = tuple(np.where(np.array(mask) == 1, layout.types[goal], EMPTY).tolist())
            for seen, share in _reports(types, pairs, error).items():
                if holes_seen:
                    seen = tuple(part if filled else EMPTY for part, filled in zip(seen, mask, strict=True))
                taken = tuple(map(bool, mask)) if holes_seen else tuple(part != EMPTY for part in seen)
                rows.setdefault((seen, taken), np.zeros(len(layout.goals)))[goal] += probability * share
    seen_rows, taken_rows = (np.array(column) for column in zip(*rows, strict=True))
    return Joint(layout, seen_rows, taken_rows, np.array(list(rows.values())))


def uniform_states(layout: Layout) -> dict[tuple[int, ...], Floats]:
    """Every non-empty proper subset of every goal's slots alike: the 186 scenarios of the default product."""
    goals, m = layout.types.shape
    share = np.full(goals, 1.0 / (goals * (2**m - 2)))
    return {mask: share for mask in _masks(m) if 0 < sum(mask) < m}


def run_states(layout: Layout, depth: int, demonstrators: Demonstrators | None = None) -> dict[tuple[int, ...], Floats]:
    """After 1 .. `depth` placements, each number alike; in random order, or as people do it."""
    goals, m = layout.types.shape
    habits = None if demonstrators is None else set_probabilities(demonstrators)
    states = {}
    for mask in _masks(m):
        k = sum(mask)
        if 1 <= k <= depth:
            bits = sum(filled << i for i, filled in enumerate(mask))
            share = np.full(goals, 1.0 / comb(m, k)) if habits is None else habits[:, bits]
            states[mask] = share / (goals * depth)
    return states


def trade_off(belief: Floats, wrong: Floats, weights: Floats) -> tuple[Floats, Floats]:
    """Coverage and share of wrong placements as the threshold falls from 1; states of equal belief come together.

    Args:
        belief: (R,) in the best placement of a state.
        wrong: (R,) probability that it is wrong.
        weights: (R,) of the states; sum to 1.
    """
    order = np.argsort(-belief, kind="stable")
    coverage = weights[order].cumsum()
    mistakes = (wrong * weights)[order].cumsum() / coverage
    last = np.append(np.diff(belief[order]) < -1e-9, True)
    return coverage[last], mistakes[last]


def best_coverage(coverage: Floats, mistakes: Floats, limit: float) -> float:
    """The most states that can be acted on with at most this share of wrong placements."""
    legal: Bools = mistakes <= limit
    return float(coverage[legal].max()) if legal.any() else 0.0


def _masks(m: int) -> list[tuple[int, ...]]:
    return [tuple(bits >> i & 1 for i in range(m)) for bits in range(2**m)]


def _reports(types: tuple[int, ...], pairs: list[tuple[int, int]], error: float) -> dict[tuple[int, ...], float]:
    """Distribution of what is reported of one true state."""
    reports = {types: 1.0}
    for position, part in enumerate(types):
        if part == EMPTY:
            continue
        after: dict[tuple[int, ...], float] = {}
        for seen, probability in reports.items():
            others = [
                (other, place)
                for other, place in pairs
                if (other, place) != (part, position) and (place == position or seen[place] == EMPTY)
            ]
            missed = error * probability if others else 0.0
            after[seen] = after.get(seen, 0.0) + probability - missed
            for other, place in others:
                row = list(seen)
                row[position] = EMPTY
                row[place] = other
                after[tuple(row)] = after.get(tuple(row), 0.0) + missed / len(others)
        reports = {seen: probability for seen, probability in after.items() if probability > LEAST}
    return reports
