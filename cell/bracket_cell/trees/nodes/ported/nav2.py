"""Nav2's controls and decorators, with its names and ports: recovery, round robin, pipeline, rates.

What they do is in: https://docs.nav2.org/behavior_trees/overview/nav2_specific_nodes.html.
"""

from __future__ import annotations

from typing import Any

from bracket_cell.trees.nodes.poses import tool_speed_m_s
from bracket_cell.trees.nodes.services import Services
from btxml.engine.errors import NodeError
from btxml.engine.node import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, Control, Decorator
from btxml.engine.ports import InputPort
from btxml.engine.status import Status
from btxml.engine.traits import Traits

ROUNDING_S = 1e-6  # a period of whole ticks is over in its last one


class RecoveryNode(Control):
    """Ticks the second child where the first one fails, and then the first again; at most one recovery a tick."""

    children_min = 2
    children_max = 2
    traits = Traits(
        instant=True,
        results=lambda below, _: below[0],
        barrier=lambda _, below: None if FAILURE in below[0] else 0,
    )

    number_of_retries = InputPort(int, "recoveries before it fails", default=1)

    _recovers = False
    _recoveries = 0

    def run(self) -> Status:
        self.set_status(RUNNING)
        main, recovery = self.children
        if not self._recovers and (ended := self._main(main.execute())) is not None:
            return ended
        status = recovery.execute()
        if status is RUNNING:
            return RUNNING
        if status is not SUCCESS:
            return self._end(FAILURE)
        recovery.reset_status()
        self._recovers, self._recoveries = False, self._recoveries + 1
        ended = self._main(main.execute())
        return RUNNING if ended is None else ended

    def _main(self, status: Status) -> Status | None:
        """What the first child's result means; None where the second one is to recover."""
        if status is RUNNING:
            return RUNNING
        if status is FAILURE and self._recoveries < self.number_of_retries.get():
            self.children[0].reset_status()
            self._recovers = True
            return None
        return self._end(status)

    def _end(self, status: Status) -> Status:
        self.on_halt()
        return status

    def on_halt(self) -> None:
        self._recovers, self._recoveries = False, 0


class RoundRobin(Control):
    """Succeeds with the first child that does, and begins with the next one after that; fails where all fail."""

    wrap_around = InputPort(bool, "go on with the first child after the last one", default=False)

    _index = 0
    _failed = 0

    def run(self) -> Status:
        self.set_status(RUNNING)
        count, skipped = len(self.children), 0
        while self._failed + skipped < count:
            status = self.children[self._index].execute()
            if status is RUNNING:
                return RUNNING
            self._index = (self._index + 1) % count
            if status is SUCCESS:
                self._failed = 0
                return SUCCESS
            skipped += status is SKIPPED
            self._failed += status is FAILURE
            if self._index == 0 and not self.wrap_around.get():
                break
        self.on_halt()
        return SKIPPED if skipped == count else FAILURE

    def on_halt(self) -> None:
        self._index = self._failed = 0


class PipelineSequence(Control):
    """A Sequence that ticks all earlier children again while a later one runs, and does not wait for them."""

    traits = Traits(instant=True, at_once=True)

    _farthest = 0

    def run(self) -> Status:
        self.set_status(RUNNING)
        skipped = 0
        for number, child in enumerate(self.children):
            status = child.execute()
            if status is FAILURE:
                self.on_halt()
                return FAILURE
            if status is RUNNING and number >= self._farthest:
                self._farthest = number
                return RUNNING
            skipped += status is SKIPPED
        self.on_halt()
        return SKIPPED if skipped == len(self.children) else SUCCESS

    def on_halt(self) -> None:
        self._farthest = 0


class _Paced(Decorator):
    """Begins its child at once, and again after it ended once a period is over; a child that runs is always ticked."""

    abstract = True
    traits = Traits(results=lambda below, _: below[0], succeeds_after="all")

    _first = True
    _start_s = 0.0
    _period_s = 0.0

    def begin(self) -> float:
        """The first period in [s]."""
        raise NotImplementedError

    def after(self, status: Status, over: bool) -> None:
        """The child was ticked, with `over` because a period was over."""
        raise NotImplementedError

    def run(self) -> Status:
        if self.status is IDLE or self.status is SKIPPED:
            self._period_s, self._start_s, self._first = self.begin(), self.now_s, True
        self.set_status(RUNNING)
        over = self.now_s - self._start_s >= self._period_s - ROUNDING_S
        if not (self._first or over or self.decorated.status is RUNNING):
            return RUNNING
        self._first = False
        status = self.decorated.execute()
        self.after(status, over)
        return status

    @property
    def now_s(self) -> float:
        """Time of the cell."""
        return self.runtime.clock.now_s()


class RateController(_Paced):
    """Begins its child with a rate at most; RUNNING in between."""

    hz = InputPort(float, "the rate in [Hz]", default=10.0)

    def begin(self) -> float:
        return _period_s("hz", self.hz.get())

    def after(self, status: Status, over: bool) -> None:  # noqa: ARG002
        if status is SUCCESS:
            self._start_s = self.now_s


class SpeedController(_Paced):
    """Begins its child the more often, the faster the tool moves, and at once for another goal; RUNNING in between."""

    min_rate = InputPort(float, "rate in [Hz] at the lower speed", default=0.1)
    max_rate = InputPort(float, "rate in [Hz] at the upper speed", default=1.0)
    min_speed = InputPort(float, "the lower speed in [m/s]", default=0.0)
    max_speed = InputPort(float, "the upper speed in [m/s]", default=0.5)
    goal = InputPort(Any, "where the tool goes", optional=True)
    goals = InputPort(Any, "where the tool goes, one after the other", optional=True)
    services: Services

    def setup(self, **kwargs: Any) -> None:
        """Take the services."""
        self.services = kwargs["services"]

    def begin(self) -> float:
        self._goals = self._meant()
        return _period_s("max_rate", self.max_rate.get())

    def run(self) -> Status:
        if self.status is RUNNING and self._meant() != self._goals:
            self._period_s, self._start_s, self._first = self.begin(), self.now_s, True
        return super().run()

    def after(self, status: Status, over: bool) -> None:  # noqa: ARG002
        if not over:
            return
        low, high = self.min_speed.get(), self.max_speed.get()
        if high <= low:
            raise NodeError(f"max_speed is {high:g}; more than min_speed, which is {low:g}")
        slow, fast = 1 / _period_s("min_rate", self.min_rate.get()), self.max_rate.get()
        share = min(1.0, max(0.0, (tool_speed_m_s(self.services) - low) / (high - low)))
        self._period_s, self._start_s = _period_s("max_rate", slow + share * (fast - slow)), self.now_s

    def _meant(self) -> tuple[object, object]:
        return self.goal.get_or(None), self.goals.get_or(None)


def _period_s(name: str, rate_hz: float) -> float:
    if not rate_hz > 0:
        raise NodeError(f"{name} is {rate_hz:g}; a rate is more than 0")
    return 1 / rate_hz
