"""Steps a world at absolute deadlines of the wall's time."""

from __future__ import annotations

import time
from bisect import bisect_right
from collections.abc import Callable

from bracket_ground.interfaces.clock import Clock

CATCH_UP_S = 0.05  # a world that is further behind than this does not make up for it
KEPT = 256  # times lost that stamps may still lie before


class Pacer:
    """Steps a world at absolute deadlines, one control period at a time.

    Its stamps are in wall-clock time. A world that cannot keep pace loses time: it is slower than the wall, and
    what it has not done is not made up for in a burst.

    Args:
        period_s: one step.
        epoch_s: what `now_s` shows when the wall's time of the world is 0.
    """

    def __init__(
        self, clock: Clock, period_s: float, epoch_s: float, now_s: Callable[[], float] = time.monotonic
    ) -> None:
        self._clock, self._period_s, self._now_s, self._epoch_s = clock, period_s, now_s, epoch_s
        self._losses = [(-float("inf"), now_s() - epoch_s - clock.now_s())]  # (world's time, lost from there on)
        self._began_lost_s = self._losses[0][1]

    @property
    def lost_s(self) -> float:
        """How far the world fell behind since this pacer began."""
        return self._losses[-1][1] - self._began_lost_s

    def due_in_s(self) -> float:
        """Until the next step is due; 0 where it is."""
        return max(0.0, self._period_s - self._behind_s())

    def step(self) -> None:
        """Advance by one period where it is due."""
        behind_s = self._behind_s()
        if behind_s < self._period_s:
            return
        if behind_s > CATCH_UP_S:
            self._losses.append((self._clock.now_s(), self._losses[-1][1] + behind_s - self._period_s))
            del self._losses[:-KEPT]
        self._clock.sleep_until(self._clock.now_s() + self._period_s)

    def wall_s(self, world_s: float) -> float:
        """The wall's time, since the epoch, at a time of the world's."""
        place = bisect_right(self._losses, (world_s, float("inf"))) - 1
        return world_s + self._losses[max(place, 0)][1]

    def _behind_s(self) -> float:
        return self._now_s() - self._epoch_s - self._losses[-1][1] - self._clock.now_s()
