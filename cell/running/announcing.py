"""Tells people what the supervisor does, when that changes."""

from __future__ import annotations

from cell.interfaces.judgement import ACKNOWLEDGE, USUAL, Judgement
from cell.observer import Level

ONCE = ("tick_late",)  # a machine that is too slow is so again and again


class Announcer:
    """Remembers what was said."""

    def __init__(self) -> None:
        self._said: tuple[str, ...] = ()
        self._asked = False
        self._once: set[str] = set()
        self._alarm = ""

    def alarm(self, judgement: Judgement, unacknowledged: bool) -> str | None:
        """The trouble that a panel is to show until somebody acknowledges it; None where it shows that already."""
        text = f"{judgement.words}; {ACKNOWLEDGE}" if unacknowledged else ""
        if bool(text) == bool(self._alarm):
            return None
        self._alarm = text
        return text

    def news(self, judgement: Judgement, unacknowledged: bool = False) -> tuple[Level, str] | None:
        """What is to be said now, if it is something new.

        Args:
            unacknowledged: the cell waits until a person acknowledges it.
        """
        signals = [signal for signal, _ in judgement.reasons if signal not in USUAL]
        reasons = tuple(signal for signal in signals if signal not in self._once)
        asks, self._asked = unacknowledged and not self._asked, unacknowledged
        if reasons == self._said and not asks:
            return None
        self._said = tuple(signal for signal in reasons if signal not in ONCE)
        self._once |= set(reasons) & set(ONCE)
        if not reasons:
            return "info", "all clear"
        ending = f"; {ACKNOWLEDGE}" if unacknowledged else ""
        return "warning", f"{judgement.action.name.lower()}: {judgement.words}{ending}"
