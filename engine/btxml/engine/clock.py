"""The time that nodes read, and the journal that they write."""

from __future__ import annotations

from typing import Literal, Protocol


class Clock(Protocol):
    """Monotonic time in seconds since the run began."""

    def now_s(self) -> float:
        """Seconds since the run began."""
        ...


class ManualClock:
    """A clock that tests move by hand."""

    def __init__(self, time_s: float = 0.0) -> None:
        self._time_s = time_s

    def now_s(self) -> float:
        return self._time_s

    def sleep_until(self, time_s: float) -> None:
        self._time_s = max(self._time_s, time_s)


class Journal(Protocol):
    """Takes notes of a tick for a log."""

    def note(self, topic: Literal["outside"], **fields: object) -> None:
        """Write down one thing; fields hold plain data: numbers, strings, None, sequences and mappings of these."""
        ...
