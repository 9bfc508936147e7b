"""Posterior of goals, of "none of these", and of the placements that remain, from likelihoods of what was reported."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import comb, factorial, perm, prod

import numpy as np

from bracket_cell.learned.semantic.confusions import ConfusionLikelihood, Confusions, Reports
from bracket_cell.learned.semantic.graph import Floats, Layout, action_pairs
from bracket_cell.learned.semantic.hypotheses import Hypotheses, agreeing_subsets, ways, weighed
from bracket_cell.learned.semantic.settings import DETECTION_ERROR
from bracket_ground.errors import ModelError

MOST_STATES = 40_000  # sets of slots times slots times arrangements that are counted one by one: some 3 ms


def confusion_likelihood(layout: Layout, confusions: Confusions) -> ConfusionLikelihood | FactoredConfusions:
    """Exact where that takes a few milliseconds."""
    m = len(layout.positions)
    listed = 2**m * m * len(layout.hypotheses.goal) <= MOST_STATES
    return ConfusionLikelihood(layout, confusions) if listed else FactoredConfusions(layout, confusions)


class FactoredConfusions:
    """P(reports | goal) in a time that grows with slots times reports.

    A report's chance from its own slot counts as it is; its chances from other slots count by their mean:

        L = sum over the sets S of reports  prod_{r in S} (own_r - mean_r)  prod_{r not in S} mean_r  ways(k, |S|)

    which is exact where every other slot gives the report with one chance, none among them.

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

    def terms(self, filled: int | None = None, *, one_open: bool = False) -> Floats:
        """(k, i) probability of k reports of which i certain ones are right, the others stemming from any slots.

        Any k of m slots are done, all choices alike; summed over the C(m - i, k - i) (k - i)! ways in which the
        other reports may stem from the slots left.

        Args:
            filled: m, how many slots the goal fills; all positions by default. More reports are impossible.
            one_open: only those ways that leave one certain slot open.
        """
        size = len(self.wrong)
        k, i = np.arange(size)[:, None], np.arange(size)
        chances = self.excess[:, None] ** i * self.wrong[:, None] ** np.maximum(k - i, 0)
        table: Floats = chances * ways(size, size - 1 if filled is None else filled, one_open=one_open)
        return table


UNKNOWN_PRIOR = 0.02  # how often somebody builds what was never demonstrated
CACHED = 4096  # combinations of reported quantities that are kept
NEGLIGIBLE = 1e-9  # share of a listed arrangement among all, below which it need not be taken out of their mean
MOST_BAGS = 4  # quantities, of those that most goals have, in which unlisted products are expected
ANY_SHARE = 0.5  # of a family's unlisted products that may have any type in any slot


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
    """P(reports | goal) for every goal, or for every arrangement of a goal (z of them).

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
    """P(reports | an arrangement that is no goal): of the quantities of some goal, all alike, or of any types.

    The mean over all arrangements of the same parts needs no list of them: it asks only for the expected number of
    i-subsets of the reports that an arrangement agrees with, coefficients of a product of polynomials, one of each
    type. Where goals have quantities of their own, those that most goals have share what is expected, beside
    arrangements with any type in every slot.
    """

    def __init__(self, layout: Layout, noise: Noise) -> None:
        some = layout.hypotheses
        self._m, self._noise = len(layout.positions), noise
        bags, of = some.bags, np.zeros(len(some.goal))
        self._shares: list[tuple[float, tuple[int, ...]]] = []
        known = [(bag, _arrangements_n(bag) - bags[bag]) for bag, _ in bags.most_common(MOST_BAGS)]
        known = [(bag, others) for bag, others in known if others > 0]
        self.any_share = 0.0 if some.plain and len(bags) == 1 else ANY_SHARE if known else 1.0
        for bag, others in known:
            share = (1.0 - self.any_share) / len(known)
            self._shares.append((share * _arrangements_n(bag) / others, bag))
            of += [share / others if bag == own else 0.0 for own in some.bag_of()]
        self.of_goals: Floats = of  # (r,) by how much each listed arrangement makes the mean too large
        self.counts_listed = len(of) > 0 and float(of.max()) > NEGLIGIBLE
        self.possible = bool(known) or self.any_share > 0
        self._terms = {
            bag: (noise.terms(filled), noise.terms(filled, one_open=True))
            for _, bag in self._shares
            for filled in [self._m - bag[-1]]
        }
        self._all_terms = noise.terms(), noise.terms(one_open=True)
        self.mean = lru_cache(maxsize=CACHED)(self._mean)

    def _mean(self, reported: tuple[int, ...]) -> tuple[float, Floats]:
        """Mean likelihood over all arrangements, from the number of reports by type.

        Returns:
            Of the reports; and (n + 1,) of the reports together with a certain open slot that holds this type, or none.
        """
        total, still_open = 0.0, np.zeros(len(reported) + 1)
        for share, bag in self._shares:
            likelihood, open_ones = self._of_bag(reported, bag)
            total, still_open = total + share * likelihood, still_open + share * open_ones
        if self.any_share:
            k, n = sum(reported), len(reported)
            counts = np.array([comb(k, i) / n**i for i in range(k + 1)])
            terms, open_terms = self._all_terms
            total += self.any_share * float(terms[k, : k + 1] @ counts)
            still_open[:-1] += self.any_share * float(open_terms[k, : k + 1] @ counts) / n
        return total, still_open

    def _of_bag(self, reported: tuple[int, ...], bag: tuple[int, ...]) -> tuple[float, Floats]:
        k, m = sum(reported), self._m
        terms, open_terms = self._terms[bag]
        sizes = [_agreeing(reports, quantity) for reports, quantity in zip(reported, bag, strict=False)]
        everything, without = _products(sizes)
        still_open = np.zeros(len(bag))

        def mean(counts: Floats, table: Floats, slots: int) -> float:
            counts = counts[: slots + 1] / [perm(slots, i) for i in range(min(len(counts), slots + 1))]
            return float(table[k, : len(counts)] @ counts)

        for part, quantity in enumerate(bag[:-1]):
            if quantity:
                counts = np.convolve(without[part], _agreeing(reported[part], quantity - 1))
                still_open[part] = quantity / m * mean(counts, open_terms, m - 1)
        if bag[-1]:
            still_open[-1] = bag[-1] / m * mean(everything, terms, m - 1)
        return mean(everything, terms, m), still_open


def _arrangements_n(bag: tuple[int, ...]) -> int:
    return factorial(sum(bag)) // prod(factorial(count) for count in bag)


def _agreeing(reports: int, quantity: int) -> Floats:
    """Number of i-subsets of the reports of a type that so many of the parts may have given, i = 0, 1, ..."""
    return np.array([comb(reports, i) * perm(quantity, i) for i in range(min(reports, quantity) + 1)], float)


def _products(factors: list[Floats]) -> tuple[Floats, list[Floats]]:
    """The product of polynomials, and the product of all but each of them."""
    before: list[Floats] = [np.ones(1)]
    after: list[Floats] = [np.ones(1)]
    for factor in factors:
        before.append(np.convolve(before[-1], factor))
    for factor in reversed(factors):
        after.append(np.convolve(after[-1], factor))
    return before[-1], [np.convolve(left, right) for left, right in zip(before[:-1], after[-2::-1], strict=True)]


def posterior(
    edges: Floats,
    likelihood: Likelihood,
    unknown: UnknownGoal,
    prior: float = UNKNOWN_PRIOR,
    alike: Likelihood | None = None,
    some: Hypotheses | None = None,
) -> Posterior:
    """Posterior for the edges (n, m).

    Args:
        some: arrangements that the likelihoods are of; without them they are of the goals themselves.
        prior: of "none of these".
        alike: the goals' likelihood under the noise that `unknown` has, where `likelihood` is under another.

    Raises:
        ModelError: the likelihoods are no numbers, or all zero.
    """
    still = 1.0 - edges.any(axis=0)
    known = (1.0 - prior if unknown.possible else 1.0) * likelihood.prior
    goals = known * likelihood.goals
    mass = known[:, None] * likelihood.still_open
    right = placements = np.einsum("gm,gnm->nm", mass, likelihood.wanted)
    empty = np.zeros(edges.shape[1])
    if some is not None and not some.plain:
        right = np.einsum("gm,gnm->nm", mass, some.right(edges))
        empty = (mass * some.empty).sum(axis=0)
    none = 0.0
    if unknown.possible:
        mean, open_mean = unknown.mean(tuple(edges.sum(axis=1).astype(int).tolist()))
        scale = prior * likelihood.usual
        alike = alike or likelihood
        of = unknown.of_goals
        listed, of_goals = 0.0, np.zeros(edges.shape)
        if unknown.counts_listed:
            listed = float(of @ alike.goals)
            of_goals = np.einsum("g,gm,gnm->nm", of, alike.still_open, alike.wanted)
        none = scale * max(mean - listed, 0.0)
        others = scale * np.maximum(open_mean[:-1, None] - of_goals, 0.0)
        right, placements, empty = right + others, placements + others, empty + scale * open_mean[-1]
    joint = np.append(goals if some is None else np.bincount(some.goal, goals), none)
    total = float(joint.sum())
    if not (np.isfinite(total) and total > 0.0):
        raise ModelError(f"likelihoods of the goals are {likelihood.goals.tolist()}, no posterior follows from them")
    every = np.maximum(placements.sum(axis=0) + empty, 1e-300)
    return Posterior(joint / total, np.minimum(right / every, 1.0) * still)


class UniformLikelihood:
    """P(reports | goal) where any action is taken for any other alike, for people without habits of order.

    Any k of the goal's m slots are done, all choices alike. Summed over which slot each of the k reports stems from,
    a goal that fills m slots and agrees with c of them has the likelihood

        L(c, k) = sum_i C(c, i) (a - q)^i q^(k - i) (k - i)! C(m - i, k - i) / C(m, k),

    a the probability that a placement is reported right and q that it is reported as one given other: i reports are
    fixed to their own slots, the others are free. Where slots have alternatives, C(c, i) is the expected number of
    i-subsets that agree.
    """

    def __init__(self, layout: Layout, noise: Noise) -> None:
        self._some = layout.hypotheses
        sizes, self._size = np.unique(self._some.slots, return_inverse=True)
        self._terms = np.array([noise.terms(int(size)) for size in sizes])
        self._open_terms = np.array([noise.terms(int(size), one_open=True) for size in sizes])

    def __call__(self, edges: Floats) -> tuple[Floats, Floats]:
        """Likelihood (z,) of the edges (n, m), and (z, m) that together with each slot being open."""
        parts, places = np.nonzero(edges)
        right = self._some.wanted[:, parts, places]
        subsets = agreeing_subsets(right, np.ones_like(right))
        return weighed(subsets, self._terms, self._open_terms, self._size, self._some)


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
        self._some = layout.hypotheses
        self._none = unknown
        self._unknown = UnknownGoal(layout, noise)
        goals = np.full(len(layout.goals), 1.0 / len(layout.goals)) if prior is None else prior
        self._prior = goals[self._some.goal] / self._some.listed_n
        self._uniform = UniformLikelihood(layout, noise)
        self._counted = None if confusions is None else confusion_likelihood(layout, confusions)

    def __call__(self, edges: Floats, seen: Floats | None = None) -> Posterior:
        """Posterior for the edges (n, m).

        Args:
            seen: (n, m) the edges with the detector's doubts; counts where confusions are known.
        """
        some = self._some
        usual = None
        if self._counted is None or self._unknown.counts_listed:
            usual = Likelihood(*self._uniform(edges), some.wanted, self._prior)
        if self._counted is None:
            assert usual is not None
            return posterior(edges, usual, self._unknown, self._none, some=some)
        counted = Likelihood(*self._counted(edges if seen is None else seen), some.wanted, self._prior)
        return posterior(edges, counted, self._unknown, self._none, usual, some)

    @property
    def approximate(self) -> str:
        """What of the inference is approximate, and why; empty where it is exact."""
        return approximations(self._some, self._counted)


def approximations(some: Hypotheses, counted: ConfusionLikelihood | FactoredConfusions | None) -> str:
    """What of an inference is approximate, and why; empty where it is exact."""
    found = [] if counted is None else [counted.approximate]
    if some.averaged:
        found.append(f"the quantities of {', '.join(some.averaged)} leave too many arrangements: slots are independent")
    return "; ".join(remark for remark in found if remark)
