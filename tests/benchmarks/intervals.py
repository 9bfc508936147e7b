"""Confidence intervals of shares, for all benchmarks."""

from __future__ import annotations

import math

_Z_95 = 1.96


def wilson(done: int, total: int) -> tuple[float, float]:
    """Wilson's 95 % interval of a share; (0, 1) where nothing was tried."""
    if total == 0:
        return 0.0, 1.0
    share = done / total
    middle = (share + _Z_95**2 / (2 * total)) / (1 + _Z_95**2 / total)
    half = _Z_95 / (1 + _Z_95**2 / total) * math.sqrt(share * (1 - share) / total + _Z_95**2 / (4 * total**2))
    return middle - half, middle + half
