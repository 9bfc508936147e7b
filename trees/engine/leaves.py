"""BehaviorTree.CPP's leaves."""

from __future__ import annotations

from functools import cached_property
from typing import Any

from trees.engine.node import FAILURE, RUNNING, SUCCESS, Instant, Node
from trees.engine.ports import EntryPort, InputPort
from trees.engine.script import Script as Code
from trees.engine.status import Status
from trees.engine.traits import Traits


class AlwaysSuccess(Instant):
    """Succeeds."""

    traits = Traits(instant=True, results=lambda *_: frozenset((SUCCESS,)))

    def run(self) -> Status:
        return SUCCESS


class AlwaysFailure(Instant):
    """Fails."""

    traits = Traits(instant=True, results=lambda *_: frozenset((FAILURE,)))

    def run(self) -> Status:
        return FAILURE


class Sleep(Node):
    """Runs for a time, then succeeds."""

    msec = InputPort(int, "time in [ms]")

    def initialise(self) -> None:
        self._end_s = self.runtime.clock.now_s() + self.msec.get() / 1000

    def update(self) -> Status:
        return SUCCESS if self.runtime.clock.now_s() >= self._end_s else RUNNING


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

    def run(self) -> Status:
        return SUCCESS if self.script.true() else FAILURE


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
