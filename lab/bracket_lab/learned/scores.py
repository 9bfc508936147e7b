"""Scores with 95 % confidence intervals: Wilson's for shares, Student's t for means over seeds."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Sequence
from statistics import fmean

from bracket_cell.fleet.intervals import mean, wilson


def share(right: int, count: int) -> dict[str, float | int]:
    """A share with its 95 % interval."""
    low, _, high = wilson(right, count)
    return {"share": round(right / max(1, count), 4), "n": count, "low": round(low, 4), "high": round(high, 4)}


def student(numbers: Sequence[float]) -> tuple[float, float]:
    """Mean over seeds and half the width of its interval, zero for one seed."""
    found = mean(numbers)
    return found.value, found.high - found.value if len(numbers) > 1 else 0.0


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
        """Shares, each with the ends `<name>_low` and `<name>_high` of its interval and its count `<name>_n`; means."""
        scores: dict[str, float] = {}
        for name, count in self._all.items():
            scores[name] = self._right[name] / count
            scores[f"{name}_low"], _, scores[f"{name}_high"] = wilson(self._right[name], count)
            scores[f"{name}_n"] = count
        return scores | {name: fmean(values) for name, values in self._measured.items()}
