"""Intervals of shares, of means and of paired differences."""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import NormalDist, fmean, stdev
from typing import NamedTuple


class Interval(NamedTuple):
    """An estimate between its limits."""

    low: float
    value: float
    high: float

    @property
    def proved(self) -> bool:
        """Whether it is not zero: both limits are on one side of it."""
        return self.low > 0 or self.high < 0


def wilson(successes: int, count: int, level: float = 0.95) -> Interval:
    """A share with Wilson's score interval (Wilson 1927); 50 of 50 allow .929 and up, 0 of 0 all."""
    if not count:
        return Interval(0.0, math.nan, 1.0)
    z, share = _normal(level), successes / count
    middle = (share + z * z / (2 * count)) / (1 + z * z / count)
    half = z * math.sqrt(share * (1 - share) / count + z * z / (4 * count * count)) / (1 + z * z / count)
    return Interval(max(0.0, min(middle - half, share)), share, min(1.0, max(middle + half, share)))


def mean(values: Sequence[float], level: float = 0.95) -> Interval:
    """A mean with Student's interval; of one value nothing is known of its spread."""
    if len(values) < 2:
        return Interval(-math.inf, values[0] if values else math.nan, math.inf)
    from scipy.special import stdtrit  # quick enough, but for commands that ask for no mean

    half = float(stdtrit(len(values) - 1, (1 + level) / 2)) * stdev(values) / math.sqrt(len(values))
    return Interval(fmean(values) - half, fmean(values), fmean(values) + half)


def paired_mean(ones: Sequence[float], others: Sequence[float], level: float = 0.95) -> Interval:
    """How much more the others are on average, by pairs."""
    return mean([other - one for one, other in zip(ones, others, strict=True)], level)


def paired_share(ones: Sequence[bool], others: Sequence[bool], level: float = 0.95) -> Interval:
    """How much greater the share of successes is among the others, by pairs.

    Agresti and Min, "Simple improved confidence intervals for comparing matched proportions", Statistics in Medicine
    24, 2005: Wald's interval with half a pair added to each of the four kinds of pairs.
    """
    pairs = list(zip(ones, others, strict=True))
    if not pairs:
        return Interval(-1.0, math.nan, 1.0)
    gained, lost = sum(b and not a for a, b in pairs), sum(a and not b for a, b in pairs)
    count = len(pairs) + 2
    middle = (gained - lost) / count
    spread = (gained + lost + 1) / count - middle * middle
    half = _normal(level) * math.sqrt(max(0.0, spread) / count)
    return Interval(max(-1.0, middle - half), (gained - lost) / len(pairs), min(1.0, middle + half))


def _normal(level: float) -> float:
    return NormalDist().inv_cdf((1 + level) / 2)
