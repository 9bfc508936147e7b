"""BehaviorTree.CPP's control nodes."""

from __future__ import annotations

from collections.abc import Sequence as Children
from enum import Enum
from typing import Any, ClassVar, cast

from py_trees import composites
from py_trees.common import Status

from trees.errors import NodeError
from trees.node import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, Control, TreeNode
from trees.ports import Input, InputPort


class _Ordered(Control):
    """Children one after the other until one ends the round; a RUNNING one is resumed.

    Attributes:
        goes_on: a child with this result passes on to the next one; the other result ends the round.
        breathes: RUNNING is answered after each child that finished at once, so that the tree can be interrupted.
        keeps_place: after the round was ended, the next one begins at the child that ended it.
    """

    goes_on = SUCCESS
    breathes = False
    keeps_place = False

    def __init__(self, name: str, children: Children[TreeNode]) -> None:
        super().__init__(name, children)
        self._index = 0
        self._skipped = 0

    def run(self) -> Status:
        if self.status is not RUNNING:
            self._skipped = 0
            self.become(RUNNING)
        children = self.children
        while self._index < len(children):
            self.current_child = child = children[self._index]
            was_idle = child.status is IDLE
            status = child.execute()
            if status is RUNNING:
                return RUNNING
            if status is SKIPPED:
                self._skipped += 1
            elif status is not self.goes_on:
                return self._ended(status)
            self._index += 1
            if self.breathes and was_idle and status is not SKIPPED and self._index < len(children):
                return RUNNING
        all_skipped = self._skipped == len(children)
        self._index = self._skipped = 0
        self.reset_children()
        return SKIPPED if all_skipped else self.goes_on

    def rest(self) -> None:
        if not self.keeps_place:
            self._index = 0
        self.reset_children()

    def _ended(self, status: Status) -> Status:
        if self.keeps_place:
            for child in self.children[self._index :]:
                child.reset()
        else:
            self._index = 0
            self.reset_children()
        return status


class Sequence(_Ordered, composites.Sequence):
    """All children in order; fails with the first that fails and resumes a RUNNING one."""

    memory = True


class AsyncSequence(Sequence):
    """A Sequence that can be interrupted after every child, also where each finishes at once."""

    breathes = True


class SequenceWithMemory(Sequence):
    """A Sequence that, after a failure, begins again at the child that failed."""

    breathes = True
    keeps_place = True


class Fallback(_Ordered, composites.Selector):
    """Children in order until one succeeds; resumes a RUNNING one."""

    goes_on = FAILURE
    memory = True


class AsyncFallback(Fallback):
    """A Fallback that can be interrupted after every child, also where each finishes at once."""

    breathes = True


class _Reactive(Control):
    """Children from the first one on in every tick; whatever else is RUNNING is halted."""

    goes_on = SUCCESS

    def run(self) -> Status:
        self.become(RUNNING)
        all_skipped = True
        for child in self.children:
            self.current_child = child
            status = child.execute()
            if status is RUNNING:
                self._reset_others(child)
                return RUNNING
            if status is SKIPPED:
                child.reset()
            elif status is self.goes_on:
                all_skipped = False
            else:
                self.reset_children()
                return status
        self.reset_children()
        return SKIPPED if all_skipped else self.goes_on

    def _reset_others(self, running: TreeNode) -> None:
        for child in self.children:
            if child is not running and child.status is not IDLE:
                child.reset()


class ReactiveSequence(_Reactive, composites.Sequence):
    """Checks all earlier children again in every tick; fails, and halts the rest, with the first that fails."""

    memory = False


class ReactiveFallback(_Reactive, composites.Selector):
    """Checks all earlier children again in every tick; the first that succeeds or runs halts the rest."""

    goes_on = FAILURE
    memory = False


class Parallel(Control):
    """Ticks all children in every tick until enough have succeeded or failed; those that finished wait."""

    success_count = InputPort(int, "children that must succeed; negative counts from all (-1: all)", default=-1)
    failure_count = InputPort(int, "children that must fail; negative counts from all (-1: all)", default=1)

    def __init__(self, name: str, children: Children[TreeNode]) -> None:
        super().__init__(name, children)
        self._finished: set[int] = set()
        self._succeeded = 0
        self._failed = 0

    def run(self) -> Status:
        count = len(self.children)
        asked = self.success_count.get()
        needed = _threshold(asked, count)
        fatal = _threshold(self.failure_count.get(), count)
        self._check(needed, fatal)
        self.become(RUNNING)
        skipped = 0
        for index, child in enumerate(self.children):
            if index not in self._finished:
                self.current_child = child
                status = child.execute()
                if status is RUNNING and index > 0:
                    continue  # nothing new to count; at the first child the ports may ask for less than before
                if status is SKIPPED:
                    skipped += 1
                elif status is not RUNNING:
                    self._finished.add(index)
                    self._succeeded += status is SUCCESS
                    self._failed += status is FAILURE
            if self._succeeded >= needed or (asked < 0 and self._succeeded + skipped >= needed):
                return self._done(SUCCESS)
            if count - self._failed < needed or self._failed == fatal:
                return self._done(FAILURE)
        return SKIPPED if skipped == count else RUNNING

    def rest(self) -> None:
        self._clear()
        self.reset_children()

    def _check(self, needed: int, fatal: int) -> None:
        count = len(self.children)
        if needed > count or fatal > count:
            raise NodeError(f"{count} children can neither succeed {needed} times nor fail {fatal} times")

    def _done(self, status: Status) -> Status:
        self._clear()
        self.reset_children()
        return status

    def _clear(self) -> None:
        self._finished.clear()
        self._succeeded = self._failed = 0


class ParallelAll(Control):
    """Ticks all children until every one has finished; fails where too many of them failed."""

    max_failures = InputPort(int, "failures from which this node fails; negative counts from all", default=1)

    def __init__(self, name: str, children: Children[TreeNode]) -> None:
        super().__init__(name, children)
        self._finished: set[int] = set()
        self._failed = 0

    def run(self) -> Status:
        count = len(self.children)
        fatal = _threshold(self.max_failures.get(), count)
        if fatal > count:
            raise NodeError(f"{count} children cannot fail {fatal} times")
        self.become(RUNNING)
        skipped = 0
        for index, child in enumerate(self.children):
            if index in self._finished:
                continue
            self.current_child = child
            status = child.execute()
            if status is SKIPPED:
                skipped += 1
            elif status is not RUNNING:
                self._finished.add(index)
                self._failed += status is FAILURE
        if skipped == count:
            return SKIPPED
        if skipped + len(self._finished) < count:
            return RUNNING
        result = FAILURE if self._failed >= fatal else SUCCESS
        self.rest()
        return result

    def rest(self) -> None:
        self._finished.clear()
        self._failed = 0
        self.reset_children()


class IfThenElse(Control):
    """The first child decides once whether the second or the third is ticked until it finishes."""

    children_min = 2
    children_max = 3

    def __init__(self, name: str, children: Children[TreeNode]) -> None:
        super().__init__(name, children)
        self._chosen = 0

    def run(self) -> Status:
        self.become(RUNNING)
        if self._chosen == 0:
            status = self._child(0)
            if status is RUNNING or status is SKIPPED:
                return status
            self._chosen = 1 if status is SUCCESS else 2
        if self._chosen == len(self.children):
            self.rest()
            return FAILURE
        status = self._child(self._chosen)
        if status is not RUNNING:
            self.rest()
        return status

    def rest(self) -> None:
        self._chosen = 0
        self.reset_children()

    def _child(self, index: int) -> Status:
        self.current_child = child = self.children[index]
        return child.execute()


class WhileDoElse(Control):
    """The first child decides in every tick whether the second or the third goes on; the other is halted."""

    children_min = 2
    children_max = 3

    def run(self) -> Status:
        self.become(RUNNING)
        condition, *branches = self.children
        status = condition.execute()
        if status is SUCCESS or status is FAILURE:
            status = self._branch(branches, 0 if status is SUCCESS else 1)
        if status is not RUNNING:
            self.reset_children()
        return status

    def _branch(self, branches: list[TreeNode], chosen: int) -> Status:
        if len(branches) > 1:
            branches[1 - chosen].reset()
        if chosen == len(branches):
            return FAILURE
        self.current_child = child = branches[chosen]
        return child.execute()


class TryCatch(Control):
    """All children but the last in order; where one fails, the last cleans up, and this node fails."""

    children_min = 2

    catch_on_halt = InputPort(bool, "clean up after a halt, too, in one tick", default=False)

    def __init__(self, name: str, children: Children[TreeNode]) -> None:
        super().__init__(name, children)
        self._index = 0
        self._skipped = 0
        self._cleaning = False

    def run(self) -> Status:
        if self.status is not RUNNING:
            self._forget()
            self.become(RUNNING)
        work = self.children[:-1]
        while not self._cleaning and self._index < len(work):
            self.current_child = child = work[self._index]
            status = child.execute()
            if status is RUNNING:
                return RUNNING
            if status is FAILURE:
                self.reset_children()
                self._cleaning = True
            self._skipped += status is SKIPPED
            self._index += 1
        if self._cleaning:
            return self._clean()
        result = SKIPPED if self._skipped == len(work) else SUCCESS
        self._forget()
        self.reset_children()
        return result

    def rest(self) -> None:
        cleaned = self._cleaning
        self._forget()
        self.reset_children()
        if not cleaned and self.catch_on_halt.get():
            self.children[-1].execute()
            self.children[-1].reset()

    def _clean(self) -> Status:
        self.current_child = child = self.children[-1]
        if child.execute() is RUNNING:
            return RUNNING
        self._forget()
        self.reset_children()
        return FAILURE

    def _forget(self) -> None:
        self._index = self._skipped = 0
        self._cleaning = False


class _Switch(Control):
    """Ticks the child whose case equals the variable, else the last one; another that runs is halted."""

    cases: ClassVar[int]
    variable: Input[Any]

    def run(self) -> Status:
        chosen = self.children[self._match()]
        for child in self.children:
            if child is not chosen and child.status is not IDLE:
                child.reset()
        self.become(RUNNING)
        self.current_child = chosen
        status = chosen.execute()
        if status is not RUNNING:
            self.reset_children()
        return status

    def _match(self) -> int:
        value = self.variable.get_or(None)
        if value is not None:
            for index in range(self.cases):
                case: Input[Any] = getattr(self, f"case_{index + 1}")
                if self._equal(value, case.get_or(None)):
                    return index
        return self.cases

    def _equal(self, value: Any, case: Any) -> bool:
        """As strings, as enum names, or as numbers."""
        if value == case or (isinstance(value, Enum) and value.name == case):
            return True
        numbers = [self._number(value), self._number(case)]
        return None not in numbers and numbers[0] == numbers[1]

    def _number(self, value: Any) -> float | None:
        value = self.runtime.enums.get(value, value) if isinstance(value, str) else value
        try:
            return float(value)
        except (TypeError, ValueError):
            return None


def _switch(cases: int) -> type[_Switch]:
    """Switch2 to Switch6 differ only in their number of cases."""
    ports: dict[str, Any] = {"variable": InputPort(cast(Any, Any), "what is compared")}
    for number in range(1, cases + 1):
        ports[f"case_{number}"] = InputPort(str, f"value for which child {number} is ticked")
    words = {"cases": cases, "children_min": cases + 1, "children_max": cases + 1, "__doc__": _Switch.__doc__}
    return type(f"Switch{cases}", (_Switch,), {**ports, **words, "__module__": __name__})


SWITCHES = tuple(_switch(cases) for cases in range(2, 7))


def _threshold(asked: int, count: int) -> int:
    """Negative thresholds count from the number of children: -1 is all of them."""
    if asked >= 0:
        return asked
    return max(count + asked + 1, 0)
