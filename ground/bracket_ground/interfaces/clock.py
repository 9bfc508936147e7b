"""The one clock: every timeout, delay, period and timestamp reads it."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Protocol

CATCH_UP_S = 0.02  # a world this little behind the wall is not asked to hurry
CATCH_UP_TRIES = 3


class Clock(Protocol):
    """Monotonic time in seconds since the run began."""

    def now_s(self) -> float:
        """Seconds since the run began."""
        ...

    def sleep_until(self, time_s: float) -> None:
        """Return at `time_s`, or at once if it has passed; a simulator advances its world here."""
        ...


class WallClock:
    """Monotonic machine time; sleeps to absolute deadlines, so periods do not drift.

    Attributes:
        slower: seconds of the machine for each of its own, for a cell whose twin goes slower.
    """

    def __init__(self, slower: float = 1.0) -> None:
        self.slower = slower
        self._start_s = time.monotonic()

    def now_s(self) -> float:
        return (time.monotonic() - self._start_s) / self.slower

    def sleep_until(self, time_s: float) -> None:
        delay_s = (time_s - self.now_s()) * self.slower
        if delay_s > 0:
            time.sleep(delay_s)


class PacedClock:
    """The wall's time or `slower`, with a simulated world that keeps up as well as it can (`--real-time`).

    A world that is slower than the wall falls behind: then what it tells is old, and ticks begin late, as they would on
    a real cell whose computer is too slow. It begins with the first sleep: nothing goes stale while detectors load.
    """

    def __init__(self, clock: Clock, slower: float = 1.0) -> None:
        self._clock, self.slower = clock, slower
        self._wall: WallClock | None = None
        self._offset_s = clock.now_s()

    def now_s(self) -> float:
        return self._offset_s if self._wall is None else self._wall.now_s() + self._offset_s

    def sleep_until(self, time_s: float) -> None:
        self._wall = self._wall or WallClock(self.slower)
        self._clock.sleep_until(time_s)
        self._wall.sleep_until(time_s - self._offset_s)
        for _ in range(CATCH_UP_TRIES):
            if self._clock.now_s() >= self.now_s() - CATCH_UP_S:
                break
            self._clock.sleep_until(self.now_s())


class WakingClock:
    """A clock that does something whenever a sleep is over, before anything else happens."""

    def __init__(self, clock: Clock, awake: Callable[[], None]) -> None:
        self._clock = clock
        self._awake = awake

    def now_s(self) -> float:
        return self._clock.now_s()

    def sleep_until(self, time_s: float) -> None:
        self._clock.sleep_until(time_s)
        self._awake()


class ManualClock:
    """A clock that tests and replays move by hand."""

    def __init__(self, time_s: float = 0.0) -> None:
        self._time_s = time_s

    def now_s(self) -> float:
        return self._time_s

    def sleep_until(self, time_s: float) -> None:
        self._time_s = max(self._time_s, time_s)
