"""BehaviorTree.CPP's decorators."""

from __future__ import annotations

from collections.abc import Sequence as Children
from typing import Any, ClassVar, cast

from py_trees.common import Status

from trees.node import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, Decorator, TreeNode
from trees.ports import EntryPort, InputPort, OutputPort
from trees.script import Script as Code

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


class Precondition(Decorator):
    """Ticks the child only where a script is true; not asked again while the child runs."""

    if_ = InputPort(Code, "script that must be true", name="if")
    else_ = InputPort(Status, "answer where it is not", default=FAILURE, name="else")

    def __init__(self, name: str, children: Children[TreeNode]) -> None:
        super().__init__(name, children)
        self._begun = False

    def run(self) -> Status:
        self._begun = self._begun or self.if_.get().true()
        if not self._begun:
            return self.else_.get()
        self.become(RUNNING)
        status = _reset_if_done(self.decorated, self.decorated.execute())
        self._begun = status is RUNNING or status is SKIPPED
        return status

    def rest(self) -> None:
        self._begun = False
        super().rest()


class _Loop(Decorator):
    """Ticks the child once for every item of a queue, written to an entry before each round."""

    if_empty = InputPort(Status, "answer where the queue is empty", default=SUCCESS)
    queue: Any
    value: Any

    def __init__(self, name: str, children: Children[TreeNode]) -> None:
        super().__init__(name, children)
        self._child_runs = False
        self._own: list[Any] | None = None

    def run(self) -> Status:
        if self.status is not RUNNING:
            self._child_runs = False
            self._own = None
        if not self._child_runs:
            queue = self._items()
            if not queue:
                return self.if_empty.get()
            self.value.set(queue.pop(0))
        self.become(RUNNING)
        status = _reset_if_done(self.decorated, self.decorated.execute())
        self._child_runs = status is RUNNING
        return FAILURE if status is FAILURE else RUNNING

    def _items(self) -> list[Any]:
        """The list in the entry itself, so that items are used up; a copy of a queue that the file spells out."""
        if self._own is None:
            queue = self.queue.get()
            if not self.queue.constant and queue is self.queue.entry.value:
                return cast(list[Any], queue)
            self._own = list(queue)
        return self._own


class LoopInt(_Loop):
    """Ticks the child once for every whole number of a queue."""

    queue = InputPort(list[int], "the items, used up from the front")
    value = OutputPort(int, "the item of this round")


class LoopBool(_Loop):
    """Ticks the child once for every true or false of a queue."""

    queue = InputPort(list[bool], "the items, used up from the front")
    value = OutputPort(bool, "the item of this round")


class LoopDouble(_Loop):
    """Ticks the child once for every number of a queue."""

    queue = InputPort(list[float], "the items, used up from the front")
    value = OutputPort(float, "the item of this round")


class LoopString(_Loop):
    """Ticks the child once for every string of a queue."""

    queue = InputPort(list[str], "the items, used up from the front")
    value = OutputPort(str, "the item of this round")


class _Updated(Decorator):
    """Ticks the child where an entry was written since this node last looked; `otherwise` where it was not."""

    otherwise: ClassVar[Status]

    entry = EntryPort("the entry", "input")

    def __init__(self, name: str, children: Children[TreeNode]) -> None:
        super().__init__(name, children)
        self._seen = 0

    def run(self) -> Status:
        if self.decorated.status is not RUNNING:
            if self.entry.revision == self._seen:
                return self.otherwise
            self._seen = self.entry.revision
        self.become(RUNNING)
        return _reset_if_done(self.decorated, self.decorated.execute())


class SkipUnlessUpdated(_Updated):
    """Skips the child until the entry is written, and again until it is written anew."""

    otherwise = SKIPPED


class WaitValueUpdate(_Updated):
    """Runs until the entry is written, then ticks the child."""

    otherwise = RUNNING


def _reset_if_done(child: TreeNode, status: Status) -> Status:
    if status is SUCCESS or status is FAILURE:
        child.reset()
    return status
