"""How long a training may take, as people write it."""

from __future__ import annotations

import re

from cell.errors import InputError

UNITS_S = {"s": 1, "m": 60, "h": 3600}


def seconds(text: str) -> float:
    """Seconds of "90s", "30m" or "1.5h".

    Raises:
        InputError: it is written otherwise, or nothing.
    """
    found = re.fullmatch(r"(\d+(?:\.\d+)?)([smh])", text.strip())
    if found is None or float(found[1]) == 0:
        raise InputError(f"--budget {text}: must be a number with its unit, and more than nothing, as 90s, 30m or 2h")
    return float(found[1]) * UNITS_S[found[2]]
