"""BehaviorTree.CPP's decorators."""

from __future__ import annotations

from collections.abc import Mapping
from collections.abc import Sequence as Children
from dataclasses import replace
from typing import ClassVar

from btxml.engine.errors import NodeError
from btxml.engine.node import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, Decorator, TreeNode
from btxml.engine.ports import EntryPort, InputPort
from btxml.engine.script import Evaluated, Script
from btxml.engine.script import Script as Code
from btxml.engine.status import ANY, NEVER, Results, Status
from btxml.engine.traits import Traits
from btxml.engine.why import ALWAYS, Decision, History


def _passing(adds: Results = NEVER) -> Traits:
    """Of a decorator that answers what its child answers, and perhaps more; it begins no child again."""
    return Traits(comes_back=False, results=lambda below, _: below[0] | adds if below else ANY)


class SubTree(Decorator):
    """Another tree of the file, with a blackboard of its own joined by its attributes."""

    node_type = "SubTree"
    traits = replace(_passing(), instant=True, succeeds_after="all")

    def run(self) -> Status:
        self.set_status(RUNNING)
        return self.decorated.execute()


def _mapped(on_success: Status, on_failure: Status, on_skip: Status = SKIPPED) -> Traits:
    """Of a decorator that answers so where its child ends so."""
    answers = {SUCCESS: on_success, FAILURE: on_failure, SKIPPED: on_skip}

    def results(below: Children[Results], _: Mapping[str, str]) -> Results:
        return frozenset(answers[status] for status in below[0]) - {RUNNING}

    return Traits(instant=True, comes_back=False, results=results)


class _Mapped(Decorator):
    """Changes the child's result."""

    on_success = SUCCESS
    on_failure = FAILURE

    def run(self) -> Status:
        self.set_status(RUNNING)
        status = self.decorated.execute()
        if status is SUCCESS:
            return self.on_success
        return self.on_failure if status is FAILURE else status

    def decision(self, answer: Status, history: History) -> Decision:
        """The child, even where the answer is always the same."""
        base = super().decision(answer, history)
        if self.on_success is not self.on_failure or answer is RUNNING:
            return base
        return Decision((self.decorated,), f"{ALWAYS[answer]}, whatever is below it", fixed=True)


class Inverter(_Mapped):
    """Turns SUCCESS into FAILURE and FAILURE into SUCCESS."""

    traits = _mapped(FAILURE, SUCCESS)
    on_success = FAILURE
    on_failure = SUCCESS


class ForceSuccess(_Mapped):
    """Succeeds whatever the child's result is."""

    traits = _mapped(SUCCESS, SUCCESS)
    on_failure = SUCCESS


class ForceFailure(_Mapped):
    """Fails whatever the child's result is."""

    traits = _mapped(FAILURE, FAILURE)
    on_success = FAILURE


class KeepRunningUntilFailure(Decorator):
    """Begins the child again in the next tick until it fails."""

    traits = replace(_mapped(RUNNING, FAILURE, RUNNING), instant=False, comes_back=True)

    def run(self) -> Status:
        self.set_status(RUNNING)
        if self.decorated.execute() is FAILURE:
            return FAILURE
        if self.decorated.status is not RUNNING:
            self.decorated.reset_status()
        return RUNNING


class Timeout(Decorator):
    """Halts a child that still runs when the time is up, and fails."""

    traits = replace(_passing(frozenset((FAILURE,))), succeeds_after="all")

    msec = InputPort(int, "time in [ms], counted from the first tick", least=1)

    _deadline_s: float | None = None

    def run(self) -> Status:
        now_s = self.runtime.clock.now_s()
        if self.status is not RUNNING:
            limit_ms = self.msec.get()
            self._deadline_s = now_s + limit_ms / 1000 if limit_ms > 0 else None
        self.set_status(RUNNING)
        end_s = self._deadline_s
        if end_s is not None and self.compare(now_s, ">=", self.msec, limit=end_s):
            self.feedback_message = f"time is up after {self.msec.get()} ms"
            return FAILURE
        self.feedback_message = ""
        return self.decorated.execute()

    def decision(self, answer: Status, history: History) -> Decision:
        """Its own words where the time is up, with what it halted."""
        if answer is not FAILURE or not self.feedback_message:
            return super().decision(answer, history)
        below = history.halted_below(self)
        halted = [f"{leaf.name} runs" + f" ({leaf.feedback_message})" * bool(leaf.feedback_message) for leaf in below]
        words = self.feedback_message + (f", while {', '.join(halted)}" if halted else "")
        return Decision((), words, f"if {self.decorated.name} had ended within {self.msec.get()} ms")


class Delay(Decorator):
    """Waits before it ticks the child."""

    traits = _passing()
    delay_msec = InputPort(int, "time in [ms] before the child's first tick", least=0)

    _start_s = 0.0

    def run(self) -> Status:
        now_s = self.runtime.clock.now_s()
        if self.status is not RUNNING:
            self._start_s = now_s + self.delay_msec.get() / 1000
            self.set_status(RUNNING)
        if self.compare(now_s, "<", self.delay_msec, limit=self._start_s):
            return RUNNING
        return self.decorated.execute()

    def decision(self, answer: Status, history: History) -> Decision:
        if answer is RUNNING and not history.those(self, RUNNING):
            return Decision((), f"waits {self.delay_msec.get()} ms before {self.decorated.name}")
        return super().decision(answer, history)


class RunOnce(Decorator):
    """Ticks the child to its end once in the tree's life; afterwards it is skipped, or its result repeated."""

    traits = _passing(ANY)
    then_skip = InputPort(bool, "answer SKIPPED afterwards instead of the first result", default=True)

    _result: Status | None = None

    def run(self) -> Status:
        if self._result is not None:
            return SKIPPED if self.then_skip.get() else self._result
        self.set_status(RUNNING)
        status = self.decorated.execute()
        if status is SUCCESS or status is FAILURE:
            self._result = status
        return status

    def decision(self, answer: Status, history: History) -> Decision:  # noqa: ARG002 - the first end counts for ever
        """The only round of the child, however long ago."""
        again = history.of(self).answered != history.of(self.decorated).answered
        return Decision((self.decorated,), "did so the only time that it was ticked" if again else "")


class Precondition(Decorator):
    """Ticks the child only if a script is true; the script is not checked again while the child runs."""

    traits = _passing(ANY)
    if_ = InputPort(Code, "script that must be true", name="if")
    else_ = InputPort(Status, "result if it is not", default=FAILURE, name="else")

    _begun = False
    _asked: Evaluated | None = None

    def run(self) -> Status:
        self._begun = self._begun or self.if_.get().true()
        if not self._begun:
            self._asked = self.if_.get().evaluated(False)
            return self.else_.get()
        self._asked = None
        status = self.decorated.execute()
        self._begun = status is RUNNING or status is SKIPPED
        return status

    def on_halt(self) -> None:
        self._begun = False

    def decision(self, answer: Status, history: History) -> Decision:
        """The script with the values that it had, where the child was not ticked."""
        if self._asked is None:
            return super().decision(answer, history)
        return Decision((), str(self._asked), self._asked.otherwise)


class _Updated(Decorator):
    """Ticks the child where an entry was written since this node last looked; `otherwise` where it was not."""

    traits = _passing()
    otherwise: ClassVar[Status]

    entry = EntryPort("the entry", "input")

    _seen = 0

    def run(self) -> Status:
        if self.decorated.status is not RUNNING:
            if self.entry.revision == self._seen:
                return self.otherwise
            self._seen = self.entry.revision
        return self.decorated.execute()

    def decision(self, answer: Status, history: History) -> Decision:
        if answer is not self.otherwise or history.those(self, answer):
            return super().decision(answer, history)
        name = f"{{{self.entry.entry.name}}}" if self.entry.entry else "its entry"
        return Decision((), f"{name} was not written since it looked last", f"if {name} were written")


class SkipUnlessUpdated(_Updated):
    """Skips the child until the entry is written, and then until it is written again."""

    traits = _passing(ANY)
    otherwise = SKIPPED


class WaitValueUpdate(_Updated):
    """Runs until the entry is written, then ticks the child."""

    otherwise = RUNNING


class ScriptConditions:
    """The scripts of one node, by attribute name, in BehaviorTree.CPP's order, and the guard that it needs."""

    def __init__(self, scripts: Mapping[str, Script], needs_guard: bool = False) -> None:
        self._needs_guard = needs_guard
        before = (("_failureIf", FAILURE), ("_successIf", SUCCESS), ("_skipIf", SKIPPED))
        self._before = [(name, scripts[name], status) for name, status in before if name in scripts]
        self._while = scripts.get("_while")
        self._asks = bool(self._before) or self._while is not None or needs_guard
        self._success = [scripts[name] for name in ("_onSuccess", "_post") if name in scripts]
        self._failure = [scripts[name] for name in ("_onFailure", "_post") if name in scripts]
        self._halted = scripts.get("_onHalted")
        self.decided: tuple[str, Evaluated] | None = None

    def before(self, node: TreeNode) -> Status | None:
        """All are evaluated while the node is idle, `_while` also while it is RUNNING.

        Raises:
            NodeError: the node needs a guard, and none has agreed in this tick.
        """
        if not self._asks:
            return None
        self.decided = None
        idle = node.status is IDLE or node.status is SKIPPED
        if idle:
            for name, script, status in self._before:
                if script.true():
                    self.decided = name, script.evaluated(True)
                    return status
        if self._while is not None and (idle or node.status is RUNNING) and not self._while.true():
            self.decided = "_while", self._while.evaluated(False)
            if node.status is RUNNING:
                node.halt()
            return SKIPPED
        if self._needs_guard and node.runtime.agreed != node.runtime.ticks:
            raise NodeError("no guard has agreed in this tick")
        return None

    def after(self, status: Status) -> None:
        for script in self._success if status is SUCCESS else self._failure:
            script.run()

    def halted(self) -> None:
        if self._halted is not None:
            self._halted.run()
