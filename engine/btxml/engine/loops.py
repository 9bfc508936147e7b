"""Decorators that tick their child in rounds: a number of times, or once for every item of a queue."""

from __future__ import annotations

from collections.abc import Mapping
from collections.abc import Sequence as Children
from typing import Any, cast

from btxml.engine.node import FAILURE, IDLE, RUNNING, SUCCESS, Decorator
from btxml.engine.ports import InputPort, OutputPort
from btxml.engine.status import ANY, Results, Status
from btxml.engine.traits import Traits
from btxml.engine.why import VERBS, Decision, History


def _rounds(port: str, continue_on: Status) -> Traits:
    """Of a decorator of which a port says how many rounds there are."""

    def results(below: Children[Results], values: Mapping[str, str]) -> Results:
        rounds = values.get(port, "").strip()
        if rounds == "-1":
            return below[0] - {continue_on}
        return below[0] if rounds.isdigit() and int(rounds) else below[0] | {continue_on}  # there may be no round

    return Traits(results=results)


class _Rounds(Decorator):
    """Rounds of the child until one ends with another result than `continue_on`, or their number is reached."""

    continue_on = SUCCESS

    _round = 0

    def run(self) -> Status:
        if self.status is not RUNNING:
            self._round = 0
        limit = self.limit()
        self.set_status(RUNNING)
        child = self.decorated
        while self._round < limit or limit == -1:
            was_idle = child.status is IDLE
            status = child.execute()
            if status is RUNNING:
                return RUNNING
            child.reset_status()
            if status is not self.continue_on:
                return status
            self._round += 1
            if status is FAILURE:
                limit = self.limit()  # what failed may have changed it
            if was_idle and (self._round < limit or limit == -1):
                return RUNNING
        return self.continue_on

    def limit(self) -> int:
        """Number of rounds, -1 for no limit."""
        raise NotImplementedError

    def decision(self, answer: Status, history: History) -> Decision:
        """The child of the last round; the node itself between two rounds, and where there are none."""
        same = history.those(self, answer)
        if same:
            return Decision(same, f"{self._round} of {self.limit()} rounds" if answer is self.continue_on else "")
        if answer is RUNNING:
            return Decision((), f"begins round {self._round + 1} of {self.decorated.name} in the next tick")
        return Decision((), f"has {self.limit()} rounds: {self.decorated.name} is never ticked", "if it had one")


class Repeat(_Rounds):
    """Ticks the child to its end N times, one round a tick at most; fails as soon as it fails."""

    traits = _rounds("num_cycles", SUCCESS)
    num_cycles = InputPort(int, "rounds, -1 for no limit", least=1, also=(-1,))

    def limit(self) -> int:
        return self.num_cycles.get()


class RetryUntilSuccessful(_Rounds):
    """Begins a failed child again, one attempt a tick at most, until it succeeds or the attempts are used up."""

    traits = _rounds("num_attempts", FAILURE)
    continue_on = FAILURE

    num_attempts = InputPort(int, "attempts, -1 for no limit", least=1, also=(-1,))

    def limit(self) -> int:
        return self.num_attempts.get()


class _Loop(Decorator):
    """Ticks the child once for every item of a queue, written to an entry before each round."""

    traits = Traits(results=lambda *_: ANY)
    if_empty = InputPort(Status, "result if the queue is empty", default=SUCCESS)
    queue: Any
    value: Any

    _child_runs = False
    _own: list[Any] | None = None

    def run(self) -> Status:
        if self.status is not RUNNING:
            self._child_runs = False
            self._own = None
        if not self._child_runs:
            queue = self._items()
            if not queue:
                return self.if_empty.get()
            self.value.set(queue[0])
            self._keep(queue[1:])
        self.set_status(RUNNING)
        status = self.decorated.execute()
        self._child_runs = status is RUNNING
        if not self._child_runs:
            self.decorated.reset_status()
        return FAILURE if status is FAILURE else RUNNING

    def decision(self, answer: Status, history: History) -> Decision:
        """The child of the last round, unless there was nothing left to go through."""
        if history.those(self, answer):
            return super().decision(answer, history)
        if answer is RUNNING:
            return Decision((), f"begins {self.decorated.name} with the next item in the next tick")
        return Decision((), f"the queue is empty, so it {VERBS[answer]}", "if the queue held an item")

    def _items(self) -> list[Any]:
        """What is left of a queue that the file spells out, else what the entry holds."""
        return cast(list[Any], self.queue.get()) if self._own is None else self._own

    def _keep(self, items: list[Any]) -> None:
        """Keep what is left: in the entry if a list stands there; the list itself belongs to whoever wrote it."""
        entry = self.queue.entry
        if not self.queue.constant and isinstance(entry.value, list):
            entry.value = items
        else:
            self._own = items


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
