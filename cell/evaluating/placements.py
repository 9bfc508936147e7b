"""Placements by the person as they were, and as they were told: which were told in time, with part and hole right."""

from __future__ import annotations

from collections.abc import Iterable

IN_TIME_S = (-0.3, 1.0)  # a placement may be told so long after the fingers opened
Told = tuple[float, str, str]  # (time, part, position)


def matched(placed: Iterable[Told], told: Iterable[Told]) -> list[float]:
    """Delays of what was told in time with the right part and hole."""
    return [delay_s for delay_s in delays(placed, told) if delay_s is not None]


def delays(placed: Iterable[Told], told: Iterable[Told]) -> list[float | None]:
    """How late each placement was told, in time with the right part and hole, or None; what was told counts once."""
    left, found = list(told), list[float | None]()
    for time_s, *what in placed:
        fits = (number for number, one in enumerate(left) if list(one[1:]) == what and _in_time(one[0] - time_s))
        number = next(fits, None)
        found.append(None if number is None else left.pop(number)[0] - time_s)
    return found


def _in_time(delay_s: float) -> bool:
    return IN_TIME_S[0] <= delay_s <= IN_TIME_S[1]
