"""What every device of a protocol must do, whatever is behind it: simulated, recorded, or a twin's wires.

Each module has `CHECKS`, functions of a `Bench` that raise AssertionError: call them from any test of a driver. They
need nothing but this distribution.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from statistics import median

TICK_S = 0.04
CALLS = 9


def require_prompt(**calls: Callable[[], object]) -> None:
    """Check that each call comes back within a tick, as a rule: the tree must not wait for a device."""
    for name, call in calls.items():
        took_s = median(_took_s(call) for _ in range(CALLS))
        assert took_s < TICK_S, f"{name} takes {1e3 * took_s:.0f} ms, must come back within {1e3 * TICK_S:.0f}"


def _took_s(call: Callable[[], object]) -> float:
    begun_s = time.perf_counter()
    call()
    return time.perf_counter() - begun_s
