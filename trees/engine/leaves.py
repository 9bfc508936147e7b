"""BehaviorTree.CPP's leaves."""

from __future__ import annotations

from typing import Any

from py_trees.common import Status

from trees.engine.node import FAILURE, RUNNING, SUCCESS, Node
from trees.engine.ports import EntryPort, InputPort
from trees.engine.script import Script as Code


class AlwaysSuccess(Node):
    """Succeeds."""

    instant = True

    def update(self) -> Status:
        return SUCCESS


class AlwaysFailure(Node):
    """Fails."""

    instant = True
    never_succeeds = True

    def update(self) -> Status:
        return FAILURE


class Sleep(Node):
    """Runs for a time, then succeeds."""

    msec = InputPort(int, "time in [ms]")

    def initialise(self) -> None:
        self._end_s = self.runtime.clock.now_s() + self.msec.get() / 1000

    def update(self) -> Status:
        return SUCCESS if self.runtime.clock.now_s() >= self._end_s else RUNNING


class Script(Node):
    """Runs a script on the blackboard and succeeds."""

    instant = True
    code = InputPort(Code, "like n := 1; text = 'done'")

    def update(self) -> Status:
        self.code.get().run()
        return SUCCESS


class ScriptCondition(Node):
    """Succeeds where a script's value is true."""

    instant = True
    node_type = "Condition"

    code = InputPort(Code, "like n > 3 && ready")

    def update(self) -> Status:
        return SUCCESS if self.code.get().true() else FAILURE


class SetBlackboard(Node):
    """Copies a value, or another entry, into an entry."""

    instant = True
    value = InputPort(Any, "what to write")
    output_key = EntryPort("where to write it")

    def update(self) -> Status:
        self.output_key.set(self.value.get())
        return SUCCESS


class UnsetBlackboard(Node):
    """Forgets an entry's value."""

    instant = True
    key = EntryPort("the entry", "inout")

    def update(self) -> Status:
        assert self.key.entry is not None
        self.key.entry.clear()
        return SUCCESS


class WasEntryUpdated(Node):
    """Succeeds where an entry was written since this node's last tick."""

    instant = True
    node_type = "Condition"

    entry = EntryPort("the entry", "input")
    _seen = 0

    def update(self) -> Status:
        revision = self.entry.revision
        updated, self._seen = revision != self._seen, revision
        return SUCCESS if updated else FAILURE
