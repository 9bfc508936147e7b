"""How late ticks begin, and why: bounded, however long a run lasts."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping

from bracket_cell.watching.observer import Level, Observer, TickRecord

BIN_S = 1e-4
BINS = 10_000  # up to a second; what is later counts as that late
COUNTED_S = 0.005  # a tick that began so late has a cause
LOST_S = 0.5  # a world that is this far behind the wall clock is reported

Delays = Callable[[], Mapping[str, float]]


class Quantiles:
    """Counts values from 0 on in bins of one width; quantiles are their bins' upper ends."""

    def __init__(self) -> None:
        self._counts = [0] * (BINS + 1)
        self._count = 0
        self.largest = 0.0

    def add(self, value: float) -> None:
        """Count one more."""
        self._counts[min(BINS, max(0, math.ceil(value / BIN_S - 1e-6)))] += 1
        self._count += 1
        self.largest = max(self.largest, value)

    def quantile(self, share: float) -> float:
        """This share of the values is at most the answer; 0 where none was counted."""
        below = 0
        for place, count in enumerate(self._counts):
            below += count
            if self._count and below >= share * self._count:
                return self.largest if place == BINS else min(place * BIN_S, self.largest)
        return 0.0


class Lateness(Observer):
    """An observer of the times at which ticks begin.

    The causes of a late tick are the nodes and the observers of the tick before, where these took longer than a
    period, what the clock says of its last sleep (the machine woke the controller late, the world took its time to
    answer), and the reading of the devices. The longest counts.

    Args:
        period_s: of the ticks.
        delays: how long the parts of the clock's last sleep took beyond its deadline, in [s] by cause.
        lost_s: how far a simulated world fell behind the wall.
        say: told once when that is a lot.
    """

    def __init__(
        self,
        period_s: float,
        delays: Delays = dict,
        lost_s: Callable[[], float] = lambda: 0.0,
        say: Callable[[float, Level, str], None] = lambda *_: None,
    ) -> None:
        self._period_s, self._delays, self._lost_s, self._say = period_s, delays, lost_s, say
        self._late = Quantiles()
        self._causes: Counter[str] = Counter()
        self._before: TickRecord | None = None
        self._said = False

    def tick(self, record: TickRecord) -> None:
        late_s = record.observation.late_s
        self._late.add(late_s)
        if late_s > COUNTED_S:
            self._causes[self._cause(late_s)] += 1
        self._before = record
        if not self._said and self._lost_s() > LOST_S:
            self._said = True
            text = "the machine is too slow for --real-time: the simulated world falls behind the wall's time"
            self._say(record.observation.time_s, "warning", text)

    def report(self) -> dict[str, object]:
        """What was counted, by keys of `cell run --json`."""
        return {
            "late_p50_s": round(self._late.quantile(0.50), 4),
            "late_p99_s": round(self._late.quantile(0.99), 4),
            "late_max_s": round(self._late.largest, 4),
            "late_causes": dict(self._causes.most_common()),
            "world_lost_s": round(self._lost_s(), 3),
        }

    def _cause(self, late_s: float) -> str:
        taken = dict(self._delays())
        if self._before is not None:
            beyond_s = self._before.wall_s + self._before.observers_s - self._period_s
            if beyond_s > 0:
                longer = "nodes" if self._before.wall_s >= self._before.observers_s else "observers"
                taken[longer] = beyond_s
        taken["devices"] = late_s - sum(taken.values())
        return max(taken, key=lambda cause: taken[cause])
