"""BehaviorTree.CPP's leaves."""

from __future__ import annotations

from functools import cached_property
from typing import Any

from btxml.engine.node import FAILURE, RUNNING, SUCCESS, Instant, Node
from btxml.engine.ports import EntryPort, InputPort
from btxml.engine.script import Evaluated
from btxml.engine.script import Script as Code
from btxml.engine.status import Status
from btxml.engine.traits import Traits
from btxml.engine.why import ALWAYS, Decision, History


class AlwaysSuccess(Instant):
    """Succeeds."""

    traits = Traits(instant=True, results=lambda *_: frozenset((SUCCESS,)))

    def run(self) -> Status:
        return SUCCESS

    def decision(self, answer: Status, history: History) -> Decision:
        return super().decision(answer, history)._replace(words=ALWAYS[SUCCESS], fixed=True)


class AlwaysFailure(Instant):
    """Fails."""

    traits = Traits(instant=True, results=lambda *_: frozenset((FAILURE,)))

    def run(self) -> Status:
        return FAILURE

    def decision(self, answer: Status, history: History) -> Decision:
        return super().decision(answer, history)._replace(words=ALWAYS[FAILURE], fixed=True)


class Sleep(Node):
    """Runs for a time, then succeeds."""

    msec = InputPort(int, "time in [ms]", least=0)

    def initialise(self) -> None:
        self._end_s = self.runtime.clock.now_s() + self.msec.get() / 1000

    def update(self) -> Status:
        over = self.compare(self.runtime.clock.now_s(), ">=", self.msec, limit=self._end_s)
        return SUCCESS if over else RUNNING

    def decision(self, answer: Status, history: History) -> Decision:
        base = super().decision(answer, history)
        return Decision((), f"waits {self.msec.get()} ms") if answer is RUNNING else base


class Script(Instant):
    """Runs a script on the blackboard and succeeds."""

    code = InputPort(Code, "like n := 1; text = 'done'")

    @cached_property
    def script(self) -> Code:
        """The script, which a file always spells out."""
        return self.code.get()

    def run(self) -> Status:
        self.script.run()
        return SUCCESS


class ScriptCondition(Script):
    """Succeeds if a script's value is true."""

    node_type = "Condition"

    code = InputPort(Code, "like n > 3 && ready")

    _asked: Evaluated | None = None

    def run(self) -> Status:
        true = self.script.true()
        self._asked = self.script.evaluated(true)
        return SUCCESS if true else FAILURE

    def decision(self, answer: Status, history: History) -> Decision:
        """The script with the values that it had."""
        if self.feedback_message or self._asked is None:
            return super().decision(answer, history)
        return Decision((), str(self._asked), self._asked.otherwise)


class SetBlackboard(Instant):
    """Copies a value, or another entry, into an entry."""

    value = InputPort(Any, "what to write")
    output_key = EntryPort("where to write it")

    def run(self) -> Status:
        self.output_key.set(self.value.get())
        return SUCCESS


class UnsetBlackboard(Instant):
    """Forgets an entry's value."""

    key = EntryPort("the entry", "inout")

    def run(self) -> Status:
        assert self.key.entry is not None
        self.key.entry.clear()
        return SUCCESS


class WasEntryUpdated(Instant):
    """Succeeds if an entry was written since this node's last tick."""

    node_type = "Condition"

    entry = EntryPort("the entry", "input")
    _seen = 0

    def run(self) -> Status:
        revision = self.entry.revision
        updated, self._seen = revision != self._seen, revision
        return SUCCESS if updated else FAILURE

    def decision(self, answer: Status, history: History) -> Decision:
        if self.feedback_message or self.entry.entry is None:
            return super().decision(answer, history)
        name = f"{{{self.entry.entry.name}}}"
        was = "was" if answer is SUCCESS else "was not"
        otherwise = f"if {name} were {'not ' if answer is SUCCESS else ''}written"
        return Decision((), f"{name} {was} written since it was asked last", otherwise)
