"""Shares with confidence intervals, and means."""

from __future__ import annotations

import math
from collections import Counter, defaultdict

_Z_95 = 1.96


class Tally:
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
        """Shares, each with `<name>_ci95`, and means."""
        scores: dict[str, float] = {}
        for name, count in self._all.items():
            share = self._right[name] / count
            scores[name] = share
            scores[f"{name}_ci95"] = half_width(share, count)
        return scores | {name: sum(values) / len(values) for name, values in self._measured.items()}


def half_width(share: float, count: int) -> float:
    """Half width of Wilson's 95 % interval, which does not collapse at 0 and 1."""
    spread = math.sqrt(share * (1 - share) / count + _Z_95**2 / (4 * count**2))
    return _Z_95 * spread / (1 + _Z_95**2 / count)
