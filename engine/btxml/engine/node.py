"""Base classes of all nodes, with BehaviorTree.CPP's life cycle, and what holds whatever a node does.

The engine, and no node, sees to it that
- a node is RUNNING only below RUNNING nodes: who ends, or is halted, halts what still runs below it;
- a leaf is terminated exactly once for every time that it was begun;
- a node that needs a guard is ticked only after one agreed in the same tick.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Protocol, final

from btxml.engine.causes import compared
from btxml.engine.clock import Clock, Journal, ManualClock
from btxml.engine.errors import NodeError
from btxml.engine.ports import Input, Port
from btxml.engine.status import FAILURE as FAILURE
from btxml.engine.status import IDLE as IDLE
from btxml.engine.status import RUNNING as RUNNING
from btxml.engine.status import SKIPPED as SKIPPED
from btxml.engine.status import SUCCESS as SUCCESS
from btxml.engine.status import Status
from btxml.engine.traits import Traits, refuse_former, refuse_own
from btxml.engine.why import VERBS, Decision, History, Placed

if TYPE_CHECKING:
    from btxml.engine.outside import LoggedAnswers
    from btxml.engine.script import Evaluated


@dataclass(frozen=True)
class StatusChange:
    """One change of one node in a tick; `old` equals `new` where only the feedback changed."""

    path: str
    uid: int
    old: Status
    new: Status
    feedback: str

    @cached_property
    def json(self) -> str:
        """As a log writes it; worked out once, as a tree tells the same change of the same node by the same object."""
        return json.dumps({**vars(self), "old": self.old.name, "new": self.new.name})


@dataclass
class Runtime:
    """What all nodes of one tree share while it runs.

    Attributes:
        enums: values by the enum names that scripts and cases know.
        changes: (node, old status, new status, feedback) since the tick began; bare, as every tick fills it and
            only a log or a monitor reads it. The list stays the same one; a tick empties it.
        ticks: how many ticks and halts there were, with the one under way.
        agreed: number of the last tick in which a guard agreed.
        journal: takes notes for the log.
        answers: of a log, for who would ask beyond the cell; None where it is to ask.
        history: what the nodes answered.
        place_of: file and line of a node, or of one of its attributes.
    """

    clock: Clock = field(default_factory=ManualClock)
    enums: Mapping[str, Any] = field(default_factory=dict)
    changes: list[tuple[TreeNode, Status, Status, str]] = field(default_factory=list)
    ticks: int = 0
    agreed: int = -1
    journal: Journal | None = None
    answers: LoggedAnswers | None = None
    history: History = field(default_factory=History)
    place_of: Placed = lambda *_: ("", 0)


class Conditions(Protocol):
    """Pre- and post-conditions of one node, written in the tree file.

    Attributes:
        decided: the one that replaced the node's last tick, by its name in the file; None where none did.
    """

    decided: tuple[str, Evaluated] | None

    def before(self, node: TreeNode) -> Status | None:
        """A status that replaces the tick, or None."""
        ...

    def after(self, status: Status) -> None:
        """Run what follows SUCCESS or FAILURE."""
        ...

    def halted(self) -> None:
        """Run what follows a halt."""
        ...


class Made(NamedTuple):
    """Where in Python a node was made, and the ports and conditions that it was given there."""

    file: str
    line: int
    attributes: Mapping[str, object]


class TreeNode:
    """A node of a tree.

    Args:
        name: its class's name unless given.
        children: nodes below it.
        attributes: of a tree that is written in Python: ports and conditions, as a file would write them.

    Attributes:
        node_type: how Groot2 files it: Action, Condition, Control, Decorator or SubTree.
        children_min, children_max: legal numbers of children; None for any number.
        tag: element name in XML, the class name unless given.
        traits: what the checks of tree files know of it.
        keeps_results: children that ended before it did keep their results; they are forgotten unless it says so.
        persistent: names of attributes that outlive an edit of the running tree, such as what was answered last.
        abstract: said by a class that is only a base of others, and no node of its own; not inherited.
        status: how it stands between two ticks.
        feedback_message: what it says about itself, to people.
        what_if: what would have let it answer otherwise, to people: "if p4 were seen empty"; that of a class is what
            would have let it succeed.
        uid: number in the tree, counted from 1 in the order of the file.
        full_path: names from the main tree to this node.
    """

    node_type: ClassVar[str] = "Action"
    children_min: ClassVar[int] = 0
    children_max: ClassVar[int | None] = 0
    tag: ClassVar[str] = ""
    traits: ClassVar[Traits] = Traits()
    keeps_results: ClassVar[bool] = False
    persistent: ClassVar[tuple[str, ...]] = ()
    abstract: ClassVar[bool] = True

    uid = 0
    full_path = ""
    conditions: Conditions | None = None
    status = IDLE
    feedback_message = ""
    what_if = ""
    _error = ""

    def __init__(self, name: str = "", children: Sequence[TreeNode] | TreeNode = (), **attributes: object) -> None:
        self.name = name or self.tag or type(self).__name__
        self.children = [children] if isinstance(children, TreeNode) else list(children)
        self._made = _made_at(sys._getframe(1), attributes)

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        refuse_former(cls)
        refuse_own(cls, _ENGINES_OWN)

    @classmethod
    def further_port(cls, name: str) -> Port | None:  # noqa: ARG003  # who overrides it reads it
        """The port that an attribute means which is not declared; None where the node takes no such attributes."""
        return None

    @final
    def attach(self, runtime: Runtime, uid: int, path: str) -> None:
        """Join a tree."""
        self.runtime = runtime
        self.note_change = runtime.changes.append  # bound once: a tick calls it more often than anything else
        self.uid = uid
        self.full_path = path

    def setup(self, **kwargs: Any) -> None:
        """Take the services; called by `Tree.setup` before the first tick."""

    def execute(self) -> Status:
        """Tick once; a node that is SKIPPED did nothing, and counts as idle."""
        raise NotImplementedError

    def run(self) -> Status:
        """What a tick does, without conditions."""
        raise NotImplementedError

    def on_halt(self) -> None:
        """What a halt does, without conditions, before what runs below is halted."""

    def decision(self, answer: Status, history: History) -> Decision:  # noqa: ARG002 - of a node without children
        """What made it answer so in the last tick; asked only where somebody wants to know why.

        Args:
            history: what the nodes of the tree answered.
        """
        what_if = vars(self).get("what_if", "") if answer is SUCCESS else self.what_if
        silent = f" without a word: {_first_line(type(self))}" if answer is FAILURE else ""
        return Decision((), str(self.feedback_message) or f"{VERBS[answer]}{silent}", str(what_if))

    @final
    def compare(
        self, measured: float, relation: str, port: Input[Any], of: str = "", limit: float | None = None, **given: float
    ) -> bool:
        """Whether a value is as a port demands, like `self.compare(age_s, "<=", self.oldest_s)`; noted for the log.

        Args:
            of: what it is about, where a port is compared for several things.
            limit: what the port makes the limit, such as an end of time; its value by default.
            given: further parameters that somebody set and the value depends on.
        """

        def place() -> tuple[str, str]:
            file, line = self.runtime.place_of(self, port.port.name)
            return self.full_path, f"{file}:{line}" if line else ""

        name, value = port.port.name, port.get()
        most = value if limit is None else limit
        return compared(place, name, measured, relation, most, "", of, **{name: value, **given})

    @property
    def raised(self) -> bool:
        """Whether an error ended it, or what stands in the file beside it, and no child."""
        return bool(self._error) and self._error is self.feedback_message

    @final
    def halt(self) -> None:
        """Bring a RUNNING node and all below it to rest; called by its parent, once."""
        if self.status is not RUNNING:
            self.reset_status()
            return
        try:
            self._guarded(self.on_halt)
        finally:
            try:
                self.reset_children()
            finally:
                self.set_status(IDLE)
        if self.conditions is not None:
            self._guarded(self.conditions.halted)

    @final
    def reset_status(self) -> None:
        """Halt if RUNNING, then forget the last result."""
        if self.status is RUNNING:
            self.halt()
        elif self.status is not IDLE:
            self.set_status(IDLE)

    @final
    def reset_children(self, keeps_results: bool = False) -> None:
        """Halt what is RUNNING below, in order, and forget results."""
        for child in self.children:
            if child.status is RUNNING:
                child.halt()
            elif (old := child.status) is not IDLE and not keeps_results:
                child.status = IDLE
                child.note_change((child, old, IDLE, child.feedback_message))

    @final
    def set_status(self, status: Status) -> None:
        """Change the status and note it."""
        old = self.status
        if status is not old:
            self.status = status
            self.note_change((self, old, status, str(self.feedback_message)))

    def _run_with(self, conditions: Conditions) -> Status:
        status = conditions.before(self)
        if status is None:
            status = self.run()
            if status is not RUNNING:
                self.reset_children(self.keeps_results)  # `_post` sees what `_onHalted` below wrote
            if status is SUCCESS and self.traits.guards:
                self.runtime.agreed = self.runtime.ticks
        if status is SUCCESS or status is FAILURE:
            try:
                conditions.after(status)
            except NodeError as error:  # what follows a node's end cannot change its result
                self.feedback_message = str(error)
        return status

    def _guarded(self, work: Callable[[], None]) -> None:
        """What halts a node, or follows its halt, may fail; its error becomes feedback."""
        try:
            work()
        except NodeError as error:
            self.feedback_message = str(error)

    def _known(self, status: object, method: str) -> Status:
        """The status that a node's own code answered; an idle one did nothing.

        Raises:
            TypeError: it is none.
        """
        if not isinstance(status, Status):
            legal = ": write `from btxml import Status`" if type(status).__name__ == "Status" else ""
            raise TypeError(f"{type(self).__name__}.{method} answered {status!r}, not a Status{legal}")
        return SKIPPED if status is IDLE else status


_ENGINES_OWN = ("attach", "execute", "halt", "reset_status", "reset_children", "set_status")


_AS = {SUCCESS: "a success", FAILURE: "a failure", RUNNING: "go on", SKIPPED: "a skip", IDLE: "a halt"}


def _first_line(kind: type) -> str:
    """What a class says of itself, as the end of a sentence."""
    return next(iter((kind.__doc__ or kind.__name__).splitlines())).strip().removesuffix(".")


def _made_at(frame: Any, attributes: Mapping[str, object]) -> Made:
    """The line outside of the constructors that made a node."""
    while frame.f_code.co_name == "__init__" and frame.f_back is not None:
        frame = frame.f_back
    return Made(frame.f_code.co_filename, frame.f_lineno, attributes)


class Instant(TreeNode):
    """A leaf of the language that answers at once: there is nothing to begin or to cancel."""

    traits = Traits(instant=True)

    @final
    def execute(self) -> Status:
        if self.feedback_message:
            self.feedback_message = ""  # of the last time
        try:
            status = self.run() if self.conditions is None else self._run_with(self.conditions)
        except NodeError as error:
            self.feedback_message = self._error = str(error)
            status = FAILURE
        old = self.status
        if status is not old:  # as `set_status`, whose call every node of every tick would pay for
            self.status = status
            self.note_change((self, old, status, self.feedback_message))
        return status


class Node(TreeNode):
    """Base of all leaves that the project writes; override `prepare`, `initialise`, `update` and `terminate`.

    `initialise` starts work, `update` polls it and answers in well under a millisecond, `terminate` cancels what
    still goes on: it is called exactly once for every `initialise`, whatever ends the node, and told by what: INVALID
    for a halt, else what `update` answered. A NodeError raised in either of the first two makes the node fail with
    its message as feedback; other exceptions halt the tree.

    Attributes:
        services: what the controller gave to `Tree.setup`; a subclass declares its type.
    """

    services: object = None

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        refuse_own(cls, ("run", "on_halt"))

    def setup(self, **kwargs: Any) -> None:
        self.services = kwargs.get("services")
        self.prepare()

    def prepare(self) -> None:
        """Check once, before the first tick, that all that is needed is there."""

    def initialise(self) -> None:
        """Begin."""

    def update(self) -> Status:
        """Go on, and say how it stands."""
        raise NotImplementedError(f"{type(self).__name__} has no update")

    def terminate(self, new_status: Status) -> None:
        """End, or cancel."""

    @final
    def execute(self) -> Status:
        if self.conditions is not None:
            status = self._execute_with(self.conditions)
        elif self.status is RUNNING:  # as `run`, whose call every leaf that waits would pay for
            message = self.feedback_message
            try:
                status = self.update()
            except BaseException as error:
                status = self._raised(error)
            if status is RUNNING:
                if self.feedback_message is not message and self.feedback_message != message:
                    self.note_change((self, RUNNING, RUNNING, str(self.feedback_message)))
                return RUNNING
            status = self._finish(status)
        else:
            status = self.run()
        if status is not self.status:
            self.set_status(status)
        return status

    @final
    def run(self) -> Status:
        message = self.feedback_message
        try:
            if self.status is not RUNNING:
                self.feedback_message = message = ""
                vars(self).pop("what_if", None)
                self.initialise()
            status = self.update()
        except BaseException as error:
            status = self._raised(error)
        if status is not RUNNING:
            return self._finish(status)
        if self.status is RUNNING and self.feedback_message != message:
            self.note_change((self, RUNNING, RUNNING, str(self.feedback_message)))
        return status

    @final
    def on_halt(self) -> None:
        self.terminate(IDLE)

    def _execute_with(self, conditions: Conditions) -> Status:
        if self.feedback_message and self.status is not RUNNING:
            self.feedback_message = ""  # of the last time
        try:
            return self._run_with(conditions)
        except NodeError as error:
            if self.status is RUNNING:
                self._guarded(self.on_halt)
            self.feedback_message = str(error)
            return FAILURE

    def _finish(self, answer: Status) -> Status:
        self.feedback_message = str(self.feedback_message)  # whatever was put there, such as an error
        try:
            self.terminate(SKIPPED if answer is IDLE else answer)
            return self._known(answer, "update")
        except NodeError as error:
            self.feedback_message = str(error)
            return FAILURE
        except BaseException:  # as above; it was terminated once, so nothing may take it for RUNNING
            self.set_status(IDLE)
            raise

    def _raised(self, error: BaseException) -> Status:
        """A NodeError is a failure; whatever else left `initialise` or `update` cancels what was begun, and goes on."""
        if isinstance(error, NodeError):
            self.feedback_message = str(error)
            return FAILURE
        try:  # a second Ctrl-C in mid-tick, too
            self.terminate(IDLE)
        finally:
            self.set_status(IDLE)
        raise error


class Branch(TreeNode):
    """A node with children."""

    @final
    def execute(self) -> Status:
        if self.feedback_message and self.status is not RUNNING:
            self.feedback_message = ""  # of the last time
        try:
            status = self.run() if self.conditions is None else self._run_with(self.conditions)
        except NodeError as error:
            status = self._fail_with(error)
        if status is RUNNING:
            if self.status is not RUNNING:
                self.set_status(RUNNING)
            return RUNNING
        for child in self.children:  # as `reset_children`, whose call every tick would pay for
            if (was := child.status) is RUNNING:
                child.halt()
            elif was is not IDLE and not self.keeps_results:
                child.status = IDLE
                child.note_change((child, was, IDLE, child.feedback_message))
        if status is not SUCCESS and status is not FAILURE:
            status = self._known(status, "run")
        if status is not (old := self.status):
            self.status = status
            self.note_change((self, old, status, self.feedback_message))
        return status

    def _fail_with(self, error: NodeError) -> Status:
        if self.status is RUNNING:
            self._guarded(self.on_halt)
        self.reset_children()
        self.feedback_message = self._error = str(error)
        return FAILURE

    def decision(self, answer: Status, history: History) -> Decision:
        """The child that answered the same, last of all; else its own words, or what its last child answered."""
        children = sorted(history.those(self, *VERBS), key=lambda child: history.of(child).answered)
        same = [child for child in children if history.answer(child, self) is answer]
        if same:
            return Decision(same[-1:])
        if self.feedback_message or not children:
            return super().decision(answer, history)
        return Decision(children[-1:], f"makes that {_AS[answer]}")


class Control(Branch):
    """A node with several children."""

    node_type = "Control"
    children_min = 1
    children_max: ClassVar[int | None] = None


class Decorator(Branch):
    """A node with one child."""

    node_type = "Decorator"
    children_min = 1
    children_max = 1

    def __init__(self, name: str = "", children: Sequence[TreeNode] | TreeNode = (), **attributes: object) -> None:
        super().__init__(name, children, **attributes)
        if self.children:
            self.decorated = self.children[0]
