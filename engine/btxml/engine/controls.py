"""Controls that tick their children in order: Sequence, Fallback and their kin."""

from __future__ import annotations

from collections.abc import Mapping
from collections.abc import Sequence as Children
from dataclasses import replace

from btxml.engine.node import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, Control, TreeNode
from btxml.engine.status import Results, Status
from btxml.engine.traits import Traits
from btxml.engine.why import Decision, History


def _in_order(continue_on: Status) -> Traits:
    """Of a round that a child with this result does not end."""
    passing = {continue_on, SKIPPED}

    def barrier(child: int, below: Children[Results]) -> int | None:
        return None if below[child - 1] & passing else child - 1

    def results(below: Children[Results], _: Mapping[str, str]) -> Results:
        last = next((n for n in range(1, len(below)) if barrier(n, below) is not None), len(below))
        found = {status for ends in below[:last] for status in ends - passing}
        if last == len(below) and below and below[-1] & passing:
            found |= {SKIPPED} if all(SKIPPED in ends for ends in below) else set()
            found |= {continue_on} if any(continue_on in ends for ends in below) else set()
        return frozenset(found)

    return Traits(instant=True, results=results, barrier=barrier)


class _InOrder(Control):
    """Children one after the other until one ends the round.

    Attributes:
        continue_on: a child with this result passes on to the next one; the other result ends the round.
    """

    continue_on = SUCCESS

    def decision(self, answer: Status, history: History) -> Decision:
        """Who ended the round, or all of it where nobody did; before a child that runs, those that let it run."""
        same = history.those(self, answer)
        if answer is self.continue_on or answer is SKIPPED or not same:
            words = "" if same else "goes on with its next child in the next tick"
            return Decision(same, words)
        asked = self.continue_on is FAILURE or self.traits.asked_before(1)
        passed = history.those(self, self.continue_on) if answer is RUNNING and asked else []
        return Decision([*passed, same[0]])


class _Ordered(_InOrder):
    """A round in which a RUNNING child is resumed.

    Attributes:
        asynchronous: RUNNING is answered after each child that finished at once, so that the tree can be interrupted.
        with_memory: after the round was ended, the next one begins at the child that ended it.
    """

    asynchronous = False
    with_memory = False
    _index = 0
    _skipped = 0

    def run(self) -> Status:
        if (was := self.status) is not RUNNING:
            self._skipped, self.status = 0, RUNNING
            self.note_change((self, was, RUNNING, self.feedback_message))
        children = self.children
        count, index = len(children), self._index
        while index < count:
            child = children[index]
            was_idle = self.asynchronous and child.status is IDLE
            status = child.execute()
            if status is RUNNING:
                self._index = index
                return RUNNING
            index += 1
            if status is self.continue_on:
                if was_idle and index < count:
                    self._index = index
                    return RUNNING
            elif status is SKIPPED:
                self._skipped += 1
            else:
                return self._ended_by(index - 1, status)
        self._index = 0
        if self.with_memory:
            self.reset_children()
        return SKIPPED if self._skipped == count else self.continue_on

    def on_halt(self) -> None:
        if not self.with_memory:
            self._index = 0

    def _ended_by(self, index: int, status: Status) -> Status:
        self._index = 0
        if self.with_memory:
            self._index = index
            self.children[index].reset_status()
        return status


class Sequence(_Ordered):
    """All children in order; fails with the first that fails and resumes a RUNNING one."""

    traits = replace(_in_order(SUCCESS), comes_back=False, succeeds_after="all")


class AsyncSequence(Sequence):
    """A Sequence that can be interrupted after every child, even if each finishes at once."""

    traits = replace(Sequence.traits, instant=False)
    asynchronous = True


class SequenceWithMemory(Sequence):
    """A Sequence that, after a failure, begins again at the child that failed."""

    traits = replace(AsyncSequence.traits, succeeds_after="")  # its first children may have succeeded long ago
    asynchronous = True
    with_memory = True
    keeps_results = True


class Fallback(_Ordered):
    """Children in order until one succeeds; resumes a RUNNING one."""

    traits = replace(_in_order(FAILURE), comes_back=False, succeeds_after="one")
    continue_on = FAILURE


class AsyncFallback(Fallback):
    """A Fallback that can be interrupted after every child, even if each finishes at once."""

    traits = replace(Fallback.traits, instant=False)
    asynchronous = True


class _Reactive(_InOrder):
    """A round from the first child on in every tick; whatever else is RUNNING is halted."""

    def run(self) -> Status:
        self.set_status(RUNNING)
        all_skipped = True
        for child in self.children:
            status = child.execute()
            if status is RUNNING:
                self._reset_others(child)
                return RUNNING
            if status is self.continue_on:
                all_skipped = False
            elif status is not SKIPPED:
                return status
        return SKIPPED if all_skipped else self.continue_on

    def _reset_others(self, running: TreeNode) -> None:
        for child in self.children:
            if child is not running and child.status is not IDLE and child.status is not SKIPPED:
                child.reset_status()


class ReactiveSequence(_Reactive):
    """Checks all earlier children again in every tick; fails, and halts the rest, with the first that fails."""

    traits = replace(_in_order(SUCCESS), succeeds_after="all", asked_before=range)


class ReactiveFallback(_Reactive):
    """Checks all earlier children again in every tick; the first that succeeds or runs halts the rest."""

    traits = replace(_in_order(FAILURE), succeeds_after="one")
    continue_on = FAILURE
