"""Scores with 95 % confidence intervals: Wilson's for shares, Student's t for means over seeds."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Sequence
from statistics import fmean, stdev

Z_95 = 1.959964


def wilson(right: int, count: int) -> tuple[float, float]:
    """Lowest and highest share that `right` of `count` allow (Wilson 1927); 50 of 50 allow .929 and up, 0 of 0 all."""
    if not count:
        return 0.0, 1.0
    share, spread = right / count, Z_95**2 / count
    middle = (share + spread / 2) / (1 + spread)
    half = Z_95 * math.sqrt(share * (1 - share) / count + spread / (4 * count)) / (1 + spread)
    return max(0.0, min(middle - half, share)), min(1.0, max(middle + half, share))


def share(right: int, count: int) -> dict[str, float | int]:
    """A share with its 95 % interval."""
    low, high = wilson(right, count)
    return {"share": round(right / max(1, count), 4), "n": count, "low": round(low, 4), "high": round(high, 4)}


def student(numbers: Sequence[float]) -> tuple[float, float]:
    """Mean over seeds and half the width of its interval, zero for one seed."""
    if len(numbers) < 2:
        return fmean(numbers), 0.0
    from scipy.stats import t  # for experiments alone: planners and their scores do without

    return fmean(numbers), float(t.ppf(0.975, len(numbers) - 1)) * stdev(numbers) / math.sqrt(len(numbers))


def latencies(times_s: Sequence[float]) -> dict[str, float]:
    """Median and 95 % of how long answers took, in [ms], as model cards have them."""
    import numpy as np

    return {f"latency_ms_p{percent}": 1e3 * float(np.percentile(times_s, percent)) for percent in (50, 95)}


class ScoreCounter:
    """Counts what was right of how many, by name."""

    def __init__(self) -> None:
        self._right: Counter[str] = Counter()
        self._all: Counter[str] = Counter()
        self._measured: defaultdict[str, list[float]] = defaultdict(list)

    def add(self, name: str, right: bool) -> None:
        """One more case."""
        self._right[name] += right
        self._all[name] += 1

    def measure(self, name: str, value: float) -> None:
        """One more value, of which the mean is wanted."""
        self._measured[name].append(value)

    def scores(self) -> dict[str, float]:
        """Shares, each with the ends `<name>_low` and `<name>_high` of its interval, and means."""
        scores: dict[str, float] = {}
        for name, count in self._all.items():
            scores[name] = self._right[name] / count
            scores[f"{name}_low"], scores[f"{name}_high"] = wilson(self._right[name], count)
        return scores | {name: fmean(values) for name, values in self._measured.items()}
