"""Placements by the person as they were, and as they were told: which were told in time, with part and hole right."""

from __future__ import annotations

from collections.abc import Iterable

from sim.data.actions import holes_of
from sim.data.recording import Assembly, Source

IN_TIME_S = (-0.3, 1.0)  # a placement may be told so long after the fingers opened
STAYS_S = 1.0  # what came to stand in a hole was placed there if it was empty for so long, and then is not
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


def releases(assembly: Assembly) -> list[tuple[int, str, str]]:
    """Number of each moment when fingers opened over a hole, and what was let go there: part and position."""
    found, opened = [], False
    for number, label in enumerate(assembly.labels):
        if label.released and not opened and label.part and label.position:
            found.append((number, label.part, label.position))
        opened = label.released
    return found


def slipped(source: Source) -> list[tuple[int, str, str]]:
    """Parts that came to stand in a hole although nobody opened the fingers for it: moment, part and position.

    By physics a part may slip out of the fingers into the hole that it was meant for, or lean there until it is pressed
    home: it was placed when it stands and the hand has let go of it.
    """
    assembly = source.assembly
    stays = round(STAYS_S * source.bench.overhead.rate_hz)
    let_go, found = releases(assembly), list[tuple[int, str, str]]()
    stands = [holes_of(source, moment) for moment in assembly.moments]
    for number in range(stays, len(stands) - stays):
        for position, now in stands[number].items():
            part, came = now[0], number
            if part is None or assembly.held[number] == part:
                continue
            while came > 0 and _comes(part, stands[came - 1][position], assembly.held[came - 1]):
                came -= 1
            rests = now == stands[number + stays][position] == (part, True)
            empty = came >= stays and all(before[position][0] is None for before in stands[came - stays : came])
            told = any(one[1:] == (part, position) and came - stays <= one[0] <= number + stays for one in let_go)
            found += [(number, part, position)] if rests and empty and not told else []
    return found


def _comes(part: str, now: tuple[str | None, bool], held: str | None) -> bool:
    """Whether a part is in a hole, and leans there or is held yet."""
    return now[0] == part and (not now[1] or held == part)


def _in_time(delay_s: float) -> bool:
    return IN_TIME_S[0] <= delay_s <= IN_TIME_S[1]
