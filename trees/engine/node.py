"""Base classes of all nodes: BehaviorTree.CPP's life cycle on py_trees' behaviours."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar, Protocol

from py_trees import behaviour, composites, decorators
from py_trees.common import Status

from cell.interfaces.clock import Clock, ManualClock
from trees.engine.ports import Port
from trees.engine.status import FAILURE as FAILURE
from trees.engine.status import IDLE as IDLE
from trees.engine.status import RUNNING as RUNNING
from trees.engine.status import SKIPPED as SKIPPED
from trees.engine.status import SUCCESS as SUCCESS
from trees.engine.status import NodeError as NodeError  # node modules import it from here
from trees.engine.traits import Traits, refuse_former


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
    """

    clock: Clock = field(default_factory=ManualClock)
    enums: Mapping[str, Any] = field(default_factory=dict)
    changes: list[tuple[TreeNode, Status, Status, str]] = field(default_factory=list)


class Conditions(Protocol):
    """Pre- and post-conditions of one node, written in the tree file."""

    def before(self, node: TreeNode) -> Status | None:
        """A status that replaces the tick, or None."""
        ...

    def after(self, status: Status) -> None:
        """Run what follows SUCCESS or FAILURE."""
        ...

    def halted(self) -> None:
        """Run what follows a halt."""
        ...


class TreeNode(behaviour.Behaviour):
    """A node of a loaded tree.

    Attributes:
        node_type: how Groot2 files it: Action, Condition, Control, Decorator or SubTree.
        children_min, children_max: legal numbers of children; None for any number.
        tag: element name in XML, the class name unless given.
        traits: what the checks of tree files know of it.
        persistent: names of attributes that outlive an edit of the running tree, such as what was answered last.
        abstract: said by a class that is only a base of others, and no node of its own; not inherited.
        uid: number in the tree, counted from 1 in the order of the file.
        full_path: names from the main tree to this node.
    """

    node_type: ClassVar[str] = "Action"
    children_min: ClassVar[int] = 0
    children_max: ClassVar[int | None] = 0
    tag: ClassVar[str] = ""
    traits: ClassVar[Traits] = Traits()
    persistent: ClassVar[tuple[str, ...]] = ()
    abstract: ClassVar[bool] = True

    uid = 0
    full_path = ""
    conditions: Conditions | None = None

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        refuse_former(cls)

    @classmethod
    def further_port(cls, name: str) -> Port | None:  # noqa: ARG003  # who overrides it reads it
        """The port that an attribute means which is not declared; None where the node takes no such attributes."""
        return None

    def attach(self, runtime: Runtime, uid: int, path: str) -> None:
        """Join a tree."""
        self.runtime = runtime
        self.note_change = runtime.changes.append  # bound once: a tick calls it more often than anything else
        self.uid = uid
        self.full_path = path

    def execute(self) -> Status:
        """Tick once; a node that is SKIPPED did nothing, and counts as idle."""
        if self.feedback_message and self.status is not RUNNING:
            self.feedback_message = ""  # of the last time
        try:
            status = self.run() if self.conditions is None else self._run_with(self.conditions)
        except NodeError as error:
            if self.status is RUNNING:
                self._guarded(self.on_halt)
            self.feedback_message = str(error)
            status = FAILURE
        old = self.status
        if status is not old:  # as `set_status`, whose call every node of every tick would pay for
            self.status = status
            self.note_change((self, old, status, self.feedback_message))
        return status

    def run(self) -> Status:
        """What a tick does, without conditions."""
        raise NotImplementedError

    def halt(self) -> None:
        """Bring a RUNNING node and all below it to rest; called by its parent, once."""
        try:
            self._guarded(self.on_halt)
        finally:
            self.set_status(IDLE)
        if self.conditions is not None:
            self._guarded(self.conditions.halted)

    def on_halt(self) -> None:
        """What a halt does, without conditions."""

    def reset_status(self) -> None:
        """Halt if RUNNING, then forget the last result."""
        if self.status is RUNNING:
            self.halt()
        elif self.status is not IDLE:
            self.set_status(IDLE)

    def set_status(self, status: Status) -> None:
        """Change the status and note it."""
        old = self.status
        if status is not old:
            self.status = status
            self.note_change((self, old, status, self.feedback_message))

    def tick(self) -> Iterator[behaviour.Behaviour]:
        """py_trees' way to tick: yields the nodes that were ticked, children first."""
        visited: list[behaviour.Behaviour] = []
        nodes = [node for node in self.iterate() if isinstance(node, TreeNode)]
        before = [vars(node).get("execute") for node in nodes]  # a monitor's hook, where there is one
        for node in nodes:
            vars(node)["execute"] = _noting(node, visited)
        try:
            self.execute()
        finally:
            for node, own in zip(nodes, before, strict=True):
                if own is None:
                    del vars(node)["execute"]
                else:
                    vars(node)["execute"] = own
        yield from visited

    def stop(self, new_status: Status = IDLE) -> None:
        """py_trees' way to halt."""
        self.reset_status()
        if new_status is not IDLE:
            self.set_status(new_status)

    def _run_with(self, conditions: Conditions) -> Status:
        status = conditions.before(self)
        if status is None:
            status = self.run()
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


def _noting(node: TreeNode, visited: list[behaviour.Behaviour]) -> Callable[[], Status]:
    """A node's `execute` that notes the node; only py_trees' own tools need it, so that no other tick pays for it."""
    execute = node.execute

    def noted() -> Status:
        status = execute()
        visited.append(node)
        return status

    return noted


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

    def setup(self, **kwargs: Any) -> None:
        """Take the services; called by `Tree.setup` before the first tick."""
        self.services = kwargs.get("services")
        self.prepare()

    def prepare(self) -> None:
        """Check once, before the first tick, that all that is needed is there."""

    def execute(self) -> Status:
        if self.conditions is not None:
            return super().execute()
        status = self.run()  # catches every NodeError by itself
        if status is not self.status:
            self.set_status(status)
        return status

    def run(self) -> Status:
        told = self.feedback_message
        try:
            if self.status is not RUNNING:
                self.feedback_message = ""
                self.initialise()
            status = self.update()
        except NodeError as error:
            self.feedback_message = str(error)
            status = FAILURE
        except BaseException:  # a second Ctrl-C in mid-tick, too: what was begun is cancelled; it is raised again
            self._cancel()
            raise
        if status is not RUNNING:
            return self._finish(status)
        if self.feedback_message is not told and self.status is RUNNING and self.feedback_message != told:
            self.note_change((self, RUNNING, RUNNING, self.feedback_message))
        return status

    def on_halt(self) -> None:
        self.terminate(IDLE)

    def _finish(self, status: Status) -> Status:
        status = SKIPPED if status is IDLE else status  # py_trees' word where a leaf does not know the other
        try:
            self.terminate(status)
            if not isinstance(status, Status):
                raise TypeError(f"{type(self).__name__}.update answered {status!r}, not a Status")
        except NodeError as error:
            self.feedback_message = str(error)
            return FAILURE
        except BaseException:  # as above; it was terminated once, so nothing may take it for RUNNING
            self.set_status(IDLE)
            raise
        return status

    def _cancel(self) -> None:
        """An exception left `initialise` or `update`: cancel what was begun, once."""
        try:
            self.terminate(IDLE)
        finally:
            self.set_status(IDLE)


class Control(TreeNode, composites.Composite):
    """A node with several children; py_trees' tools see a Composite."""

    node_type = "Control"
    children_min = 1
    children_max: ClassVar[int | None] = None
    children: list[TreeNode]  # type: ignore[assignment]

    def __init__(self, name: str, children: Sequence[TreeNode]) -> None:
        composites.Composite.__init__(self, name, children)

    def tip(self) -> behaviour.Behaviour | None:
        """The deepest node that runs, for py_trees' tools."""
        running = next((child for child in self.children if child.status is RUNNING), None)
        return behaviour.Behaviour.tip(self) if running is None else running.tip()

    def on_halt(self) -> None:
        self.reset_children()

    def reset_children(self) -> None:
        """Halt what is RUNNING below, in order, and forget results."""
        for child in self.children:
            if child.status is RUNNING:
                child.halt()
            elif (old := child.status) is not IDLE:
                child.status = IDLE
                child.note_change((child, old, IDLE, child.feedback_message))


class Decorator(TreeNode, decorators.Decorator):
    """A node with one child; py_trees' tools see a Decorator."""

    node_type = "Decorator"
    children_min = 1
    children_max = 1
    decorated: TreeNode

    def __init__(self, name: str, children: Sequence[TreeNode]) -> None:
        decorators.Decorator.__init__(self, name, children[0])

    def update(self) -> Status:
        """py_trees' hook, unused: `run` decides."""
        return self.status

    def on_halt(self) -> None:
        self.decorated.reset_status()
