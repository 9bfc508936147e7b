"""Controls that choose one of their children: by a condition, a value, or after a failure."""

from __future__ import annotations

from collections.abc import Mapping
from collections.abc import Sequence as Children
from dataclasses import replace
from enum import Enum
from functools import cached_property
from typing import Any, ClassVar, cast

from btxml.engine.literals import number_in, shown
from btxml.engine.node import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, Control, TreeNode
from btxml.engine.operators import same_number
from btxml.engine.ports import Input, InputPort
from btxml.engine.status import Results, Status
from btxml.engine.traits import Traits
from btxml.engine.why import Decision, History

_FAILS_OR_SKIPS: Results = frozenset((FAILURE, SKIPPED))


def _chosen_ends(below: Children[Results], _: Mapping[str, str]) -> Results:
    condition, *branches = below
    found = set(condition & {SKIPPED})
    for status, ends in zip((SUCCESS, FAILURE), [*branches, frozenset((FAILURE,))], strict=False):
        found |= ends if status in condition else frozenset()
    return frozenset(found)


def _never_chosen(child: int, below: Children[Results]) -> int | None:
    chooses = {1: SUCCESS, 2: FAILURE}.get(child)
    return 0 if chooses and chooses not in below[0] else None


class _Conditional(Control):
    """The second child where the first one succeeds, the third, or FAILURE, where it fails."""

    traits = Traits(instant=True, results=_chosen_ends, barrier=_never_chosen)
    children_min = 2
    children_max = 3

    def decision(self, answer: Status, history: History) -> Decision:  # noqa: ARG002 - both of them give every answer
        """The condition, where it gave the answer itself, or chose a branch that is not there; else both."""
        condition, *branches = self.children
        chosen = {SUCCESS: 0, FAILURE: 1}.get(history.answer(condition, self) or IDLE)
        if chosen is None or chosen >= len(branches):
            return Decision((condition,), "" if chosen is None else "has no branch for that, and fails")
        return Decision((condition, branches[chosen]))


class IfThenElse(_Conditional):
    """The first child decides once whether the second or the third is ticked until it finishes."""

    traits = replace(_Conditional.traits, comes_back=False)
    keeps_results = True
    _chosen = 0

    def run(self) -> Status:
        self.set_status(RUNNING)
        if self._chosen == 0:
            status = self.children[0].execute()
            if status is RUNNING or status is SKIPPED:
                return status
            self._chosen = 1 if status is SUCCESS else 2
        if self._chosen == len(self.children):
            self._chosen = 0
            return FAILURE  # the condition keeps its result until this node is halted, as in BehaviorTree.CPP
        status = self.children[self._chosen].execute()
        if status is not RUNNING:
            self._chosen = 0
            self.reset_children()
        return status

    def on_halt(self) -> None:
        self._chosen = 0


class WhileDoElse(_Conditional):
    """The first child decides in every tick whether the second or the third goes on; the other is halted."""

    traits = replace(_Conditional.traits, asked_before=lambda child: range(1 if child == 1 else 0))

    def run(self) -> Status:
        self.set_status(RUNNING)
        condition, *branches = self.children
        status = condition.execute()
        if status is SUCCESS or status is FAILURE:
            return self._branch(branches, 0 if status is SUCCESS else 1)
        return status

    def _branch(self, branches: list[TreeNode], chosen: int) -> Status:
        if len(branches) > 1:
            branches[1 - chosen].reset_status()
        if chosen == len(branches):
            return FAILURE
        return branches[chosen].execute()


class TryCatch(Control):
    """All children but the last in order; if one fails, the last cleans up, and this node fails."""

    traits = Traits(comes_back=False, results=lambda below, _: _FAILS_OR_SKIPS.union(*below[:-1]))
    children_min = 2

    catch_on_halt = InputPort(bool, "clean up after a halt, too, in one tick", default=False)

    _index = 0
    _skipped = 0
    _cleaning = False

    def run(self) -> Status:
        if self.status is not RUNNING:
            self._index = self._skipped = 0
            self._cleaning = False
            self.set_status(RUNNING)
        work = self.children[:-1]
        while not self._cleaning and self._index < len(work):
            child = work[self._index]
            status = child.execute()
            if status is RUNNING:
                return RUNNING
            if status is FAILURE:
                self.reset_children()
                self._cleaning = True
            self._skipped += status is SKIPPED
            self._index += 1
        if self._cleaning:
            return RUNNING if self.children[-1].execute() is RUNNING else FAILURE
        return SKIPPED if self._skipped == len(work) else SUCCESS

    def decision(self, answer: Status, history: History) -> Decision:
        """The first that failed, whatever cleaned up after it; before that whoever ended last."""
        failed = [child for child in history.those(self, FAILURE) if child is not self.children[-1]]
        if answer is RUNNING and failed:
            return Decision((*failed, self.children[-1]))
        return Decision(failed[:1]) if failed else super().decision(answer, history)

    def on_halt(self) -> None:
        self.reset_children()
        if not self._cleaning and self.catch_on_halt.get():
            self.children[-1].execute()


class _Switch(Control):
    """Ticks the child whose case equals the variable, otherwise the last one; any other that runs is halted."""

    traits = Traits(results=lambda below, _: _FAILS_OR_SKIPS.union(*below))
    cases: ClassVar[int]
    variable: Input[Any]

    def run(self) -> Status:
        chosen = self.children[self._match()]
        for child in self.children:
            if child is not chosen and child.status is not IDLE:
                child.reset_status()
        return chosen.execute()

    def decision(self, answer: Status, history: History) -> Decision:
        """The child of the case that was met."""
        base = super().decision(answer, history)
        value = self.variable.get_or(None)
        return base._replace(words=base.words or f"its variable is {'not set' if value is None else shown(value)}")

    def _match(self) -> int:
        """The case that equals the variable as a text, as the name of an enum, or as a number."""
        value = self.variable.get_or(None)
        if value is None:
            return self.cases
        name, number = value.name if isinstance(value, Enum) else value, self._number(value)
        for index, case in enumerate(self._case_inputs):
            wanted = case.entry.value if case.constant and case.entry else case.get_or(None)
            if wanted in (name, value) or (number is not None and self._is(wanted, number)):
                return index
        return self.cases

    @cached_property
    def _case_inputs(self) -> list[Input[Any]]:
        return [getattr(self, f"case_{number}") for number in range(1, self.cases + 1)]

    def _is(self, case: Any, number: float) -> bool:
        other = self._number(case)
        return other is not None and same_number(number, other)

    def _number(self, value: Any) -> float | None:
        if isinstance(value, str):
            value = self.runtime.enums.get(value, number_in(value))
        return value if isinstance(value, (int, float)) else None


def _switch(cases: int) -> type[_Switch]:
    """Switch2 to Switch6 differ only in their number of cases."""
    ports: dict[str, Any] = {"variable": InputPort(cast(Any, Any), "what is compared", unset_ok=True)}
    for number in range(1, cases + 1):
        ports[f"case_{number}"] = InputPort(str, f"value for which child {number} is ticked", unset_ok=True)
    words = {"cases": cases, "children_min": cases + 1, "children_max": cases + 1, "__doc__": _Switch.__doc__}
    return type(f"Switch{cases}", (_Switch,), {**ports, **words, "__module__": __name__})


SWITCHES = Switch2, Switch3, Switch4, Switch5, Switch6 = tuple(_switch(cases) for cases in range(2, 7))
