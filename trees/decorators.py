"""BehaviorTree.CPP's decorators."""

from __future__ import annotations

from collections.abc import Sequence as Children
from typing import ClassVar

from py_trees.common import Status

from trees.node import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, Decorator, TreeNode
from trees.ports import InputPort

Results = dict[Status, Status]


class SubTree(Decorator):
    """Another tree of the file, with a blackboard of its own joined by its attributes."""

    node_type = "SubTree"

    def run(self) -> Status:
        self.become(RUNNING)
        return _reset_if_done(self.decorated, self.decorated.execute())


class _Mapped(Decorator):
    """Changes the child's result."""

    results: ClassVar[Results]

    def run(self) -> Status:
        self.become(RUNNING)
        status = self.decorated.execute()
        return self.results[_reset_if_done(self.decorated, status)]


class Inverter(_Mapped):
    """Turns SUCCESS into FAILURE and FAILURE into SUCCESS."""

    results: ClassVar[Results] = {SUCCESS: FAILURE, FAILURE: SUCCESS, RUNNING: RUNNING, SKIPPED: SKIPPED}


class ForceSuccess(_Mapped):
    """Succeeds whatever the child's result is."""

    results: ClassVar[Results] = {SUCCESS: SUCCESS, FAILURE: SUCCESS, RUNNING: RUNNING, SKIPPED: SKIPPED}


class ForceFailure(_Mapped):
    """Fails whatever the child's result is."""

    results: ClassVar[Results] = {SUCCESS: FAILURE, FAILURE: FAILURE, RUNNING: RUNNING, SKIPPED: SKIPPED}


class KeepRunningUntilFailure(_Mapped):
    """Begins the child again in the next tick until it fails."""

    results: ClassVar[Results] = {SUCCESS: RUNNING, FAILURE: FAILURE, RUNNING: RUNNING, SKIPPED: RUNNING}


class _Rounds(Decorator):
    """Rounds of the child until one ends with another result than `goes_on`, or their number is reached."""

    goes_on = SUCCESS

    def __init__(self, name: str, children: Children[TreeNode]) -> None:
        super().__init__(name, children)
        self._round = 0

    def run(self) -> Status:
        limit = self.limit()
        self.become(RUNNING)
        child = self.decorated
        while self._round < limit or limit == -1:
            was_idle = child.status is IDLE
            status = child.execute()
            if status is RUNNING:
                return RUNNING
            child.reset()
            if status is SKIPPED:
                return SKIPPED
            if status is not self.goes_on:
                self._round = 0
                return status
            self._round += 1
            if was_idle and (self._round < limit or limit == -1):
                return RUNNING
        self._round = 0
        return self.goes_on

    def limit(self) -> int:
        """Number of rounds, -1 for no limit."""
        raise NotImplementedError

    def rest(self) -> None:
        self._round = 0
        super().rest()


class Repeat(_Rounds):
    """Ticks the child to its end so many times, one round a tick at most; fails as soon as it fails."""

    num_cycles = InputPort(int, "rounds, -1 for no limit")

    def limit(self) -> int:
        return self.num_cycles.get()


class RetryUntilSuccessful(_Rounds):
    """Begins a failed child again, one attempt a tick at most, until it succeeds or the attempts are used up."""

    goes_on = FAILURE

    num_attempts = InputPort(int, "attempts, -1 for no limit")

    def limit(self) -> int:
        return self.num_attempts.get()


class Timeout(Decorator):
    """Halts a child that still runs when the time is up, and fails."""

    msec = InputPort(int, "time in [ms], counted from the first tick")

    def __init__(self, name: str, children: Children[TreeNode]) -> None:
        super().__init__(name, children)
        self._deadline_s: float | None = None

    def run(self) -> Status:
        now_s = self.runtime.clock.now_s()
        if self.status is not RUNNING or self._deadline_s is None:
            limit_ms = self.msec.get()
            self._deadline_s = now_s + limit_ms / 1000 if limit_ms > 0 else None
        self.become(RUNNING)
        if self._deadline_s is not None and now_s >= self._deadline_s:
            self.feedback_message = f"time is up after {self.msec.get()} ms"
            self._deadline_s = None
            self.decorated.reset()
            return FAILURE
        self.feedback_message = ""
        return _reset_if_done(self.decorated, self.decorated.execute())


class Delay(Decorator):
    """Waits before it ticks the child."""

    delay_msec = InputPort(int, "time in [ms] before the child's first tick")

    def __init__(self, name: str, children: Children[TreeNode]) -> None:
        super().__init__(name, children)
        self._start_s = 0.0

    def run(self) -> Status:
        now_s = self.runtime.clock.now_s()
        if self.status is not RUNNING:
            self._start_s = now_s + self.delay_msec.get() / 1000
            self.become(RUNNING)
        if now_s < self._start_s:
            return RUNNING
        return _reset_if_done(self.decorated, self.decorated.execute())


class RunOnce(Decorator):
    """Ticks the child to its end once in the tree's life; afterwards it is skipped, or its result repeated."""

    then_skip = InputPort(bool, "answer SKIPPED afterwards instead of the first result", default=True)

    def __init__(self, name: str, children: Children[TreeNode]) -> None:
        super().__init__(name, children)
        self._result: Status | None = None

    def run(self) -> Status:
        if self._result is not None:
            return SKIPPED if self.then_skip.get() else self._result
        self.become(RUNNING)
        status = self.decorated.execute()
        if status is SUCCESS or status is FAILURE:
            self._result = status
            self.decorated.reset()
        return status


def _reset_if_done(child: TreeNode, status: Status) -> Status:
    if status is SUCCESS or status is FAILURE:
        child.reset()
    return status
