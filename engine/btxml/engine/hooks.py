"""Breakpoints and overrides that a monitor puts on single nodes of a running tree.

A breakpoint never holds up the loop: its node answers RUNNING until it is unlocked, and the rest is ticked on.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from enum import IntEnum
from typing import Any

from btxml.engine.errors import NodeError
from btxml.engine.literals import STATUS_WORDS
from btxml.engine.node import FAILURE, RUNNING, SUCCESS, TreeNode
from btxml.engine.status import Status
from btxml.engine.tree import Tree


class Mode(IntEnum):
    """What a hook does."""

    BREAKPOINT = 0
    REPLACE = 1


class Position(IntEnum):
    """When it does so."""

    PRE = 0
    POST = 1


@dataclass(frozen=True)
class Hook:
    """One hook, in the words of the protocol.

    Attributes:
        once: remove it when it has acted.
        desired_status: SUCCESS or FAILURE replaces the node's answer; anything else lets it answer by itself.
    """

    uid: int
    enabled: bool = True
    mode: Mode = Mode.BREAKPOINT
    once: bool = False
    desired_status: str = "SKIPPED"
    position: Position = Position.PRE

    @property
    def status(self) -> Status:
        return STATUS_WORDS.get(self.desired_status, Status.INVALID)

    def plain(self) -> dict[str, Any]:
        """The hook as plain data."""
        return {**asdict(self), "mode": int(self.mode), "position": int(self.position)}


class Hooks:
    """The hooks of one tree.

    Args:
        reached: called with the uid when a node waits at a breakpoint, once for each time.

    Attributes:
        waiting: nodes that were held at a breakpoint in the last tick.
    """

    def __init__(self, tree: Tree, reached: Callable[[int], None]) -> None:
        self._tree = tree
        self._reached = reached
        self._hooks: dict[tuple[int, Position], Hook] = {}
        self._waiting: dict[tuple[int, Position], Status] = {}
        self._unlocked: dict[tuple[int, Position], Status] = {}
        self._held: set[int] = set()
        self.waiting: frozenset[int] = frozenset()

    def insert(self, hook: Hook) -> None:
        """Add or replace the hook of a node.

        Raises:
            ValueError: there is no such node.
        """
        node = self._node(hook.uid)
        self._hooks[hook.uid, hook.position] = hook
        self._waiting.pop((hook.uid, Position.PRE), None)  # whoever waits there is told of anew
        if "execute" not in vars(node):
            vars(node)["execute"] = _Hooked(node, self)

    def remove(self, uid: int, position: Position) -> None:
        """Take a hook away; a node that waits there goes on.

        Raises:
            ValueError: there is no such hook.
        """
        if (key := (uid, position)) not in self._hooks:
            raise ValueError(f"node {uid} has no hook there")
        self._drop(key)

    def clear(self) -> None:
        """Take all hooks away."""
        for key in list(self._hooks):
            self._drop(key)

    @property
    def enabled(self) -> list[dict[str, Any]]:
        """Hooks that act, as plain data."""
        return [hook.plain() for hook in self._hooks.values() if hook.enabled]

    def disable(self) -> None:
        """Let all hooks rest; nodes that wait go on."""
        self._hooks = {key: replace(hook, enabled=False) for key, hook in self._hooks.items()}

    def unlock(self, uid: int, position: Position, answer: Status, remove: bool) -> None:
        """Let a node that waits at a breakpoint go on.

        Args:
            answer: SUCCESS or FAILURE in place of its own answer.

        Raises:
            ValueError: it does not wait.
        """
        key = (uid, position)
        if key not in self._waiting or key not in self._hooks:
            raise ValueError(f"node {uid} does not wait at a breakpoint")
        self._unlocked[key] = answer
        self.waiting -= {uid}
        self._hooks[key] = replace(self._hooks[key], once=remove or self._hooks[key].once)

    @property
    def act(self) -> bool:
        """Whether any hook may act."""
        return any(hook.enabled for hook in self._hooks.values())

    def ticked(self) -> None:
        """A tick of the tree is over; a node that nobody asked in it waits no longer."""
        self.waiting, self._held = frozenset(self._held), set()

    def dump(self) -> list[dict[str, Any]]:
        """All hooks as plain data."""
        return [hook.plain() for hook in self._hooks.values()]

    def at(self, node: TreeNode, position: Position, answer: Status) -> Status | None:
        """What a hook answers in a node's place, or None.

        Args:
            answer: the node's own, kept for a breakpoint behind it.
        """
        hook = self._hooks.get(key := (node.uid, position))
        if hook is None or not hook.enabled:
            self._waiting.pop(key, None)
            return None
        if hook.mode is Mode.BREAKPOINT and key not in self._unlocked:
            if position is Position.PRE and node.status is RUNNING:
                return None  # it has begun: it is let begin once, not tick by tick
            if key not in self._waiting:
                self._reached(node.uid)
            self._waiting[key] = answer
            self._held.add(node.uid)
            return RUNNING
        self._waiting.pop(key, None)
        status = self._unlocked.pop(key, hook.status)
        if hook.once:
            self._drop(key)
        return status if status in (SUCCESS, FAILURE) else None

    def held(self, node: TreeNode) -> Status | None:
        """The answer of a node that waits behind its end; none where it was reset meanwhile."""
        held = self._waiting.get((node.uid, Position.POST))
        return held if held is node.status else None

    def _drop(self, key: tuple[int, Position]) -> None:
        """A node that waits sees in the next tick that its hook is gone."""
        del self._hooks[key]
        self._unlocked.pop(key, None)

    def _node(self, uid: int) -> TreeNode:
        if uid > len(self._tree.nodes):
            raise ValueError(f"there is no node {uid}; the last one is {len(self._tree.nodes)}")
        return self._tree.nodes[uid - 1]


class _Hooked:
    """Stands in the place of a node's `execute`."""

    def __init__(self, node: TreeNode, hooks: Hooks) -> None:
        self._node = node
        self._hooks = hooks
        self.replaced: Status | None = None  # what it answered in the node's place, when it was ticked last

    def __call__(self) -> Status:
        node, hooks, self.replaced = self._node, self._hooks, None
        held = hooks.held(node)
        if held is None:
            replaced = hooks.at(node, Position.PRE, Status.INVALID)
            if replaced is RUNNING:
                return RUNNING  # not begun, or begun and not ticked: the node keeps its status
            if replaced is not None:
                self.replaced = replaced
                return _answer(node, _among_conditions(node, replaced))
            held = type(node).execute(node)
            if held is RUNNING:
                return RUNNING
        replaced = hooks.at(node, Position.POST, held)
        if replaced is None or replaced is RUNNING:
            return replaced or held
        self.replaced = replaced
        return _answer(node, replaced)


def _among_conditions(node: TreeNode, status: Status) -> Status:
    """What a node answers whose work is replaced: its conditions before and after hold all the same."""
    conditions = node.conditions
    if conditions is None:
        return status
    try:
        first = conditions.before(node)
        status = status if first is None else first
        if status is SUCCESS or status is FAILURE:
            conditions.after(status)
    except NodeError as error:
        node.feedback_message = str(error)
        return FAILURE
    return status


def _answer(node: TreeNode, status: Status) -> Status:
    node.reset_status()
    node.set_status(status)
    if status is SUCCESS and node.traits.guards:
        node.runtime.agreed = node.runtime.ticks
    return status


_PLACE: Mapping[str, type] = {"uid": int, "position": int}
_UNLOCK: Mapping[str, type] = {**_PLACE, "desired_status": str, "remove_when_done": bool}
_HOOK: Mapping[str, type] = {**_PLACE, "enabled": bool, "mode": int, "once": bool, "desired_status": str}


def _read(order: object, types: Mapping[str, type], required: Iterable[str]) -> dict[str, Any]:
    """The fields of an order.

    Raises:
        ValueError: the order is no mapping, or a field is missing or of another type.
    """
    if not isinstance(order, Mapping):
        raise ValueError("an order about hooks is an object with fields")
    if missing := [name for name in required if name not in order]:
        raise ValueError(f"the order lacks {', '.join(missing)}")
    fields = {name: order[name] for name in types if name in order}
    for name, value in fields.items():
        if type(value) is not types[name]:
            raise ValueError(f"{name} is {value!r}; it must be of type {types[name].__name__}")
    if fields["uid"] < 1:
        raise ValueError(f"uid is {fields['uid']}; uids count from 1")
    enums: Mapping[str, type[IntEnum]] = {"mode": Mode, "position": Position}
    return fields | {name: enums[name](fields[name]) for name in enums.keys() & fields}


def _hook(order: object) -> Hook:
    fields = _read(order, _HOOK, ("uid",))
    if unknown := set(order) - set(fields) if isinstance(order, Mapping) else ():
        raise ValueError(f"a hook has no field {', '.join(map(str, unknown))}; its fields are {', '.join(_HOOK)}")
    return Hook(**fields)


def _unlock(hooks: Hooks, order: object) -> None:
    fields = _read(order, _UNLOCK, _UNLOCK)
    if (status := STATUS_WORDS.get(fields["desired_status"])) is None:
        raise ValueError(f"desired_status is {fields['desired_status']!r}; legal are {', '.join(STATUS_WORDS)}")
    hooks.unlock(fields["uid"], fields["position"], status, fields["remove_when_done"])


def _insert(hooks: Hooks, order: object) -> None:
    """One hook, or a list of them; all are understood before the first is taken."""
    for hook in [_hook(each) for each in (order if isinstance(order, list) else [order])]:
        hooks.insert(hook)


def _remove(hooks: Hooks, order: object) -> None:
    fields = _read(order, _PLACE, _PLACE)
    hooks.remove(fields["uid"], fields["position"])


# Orders about hooks by their letters in Groot2's protocol.
ORDERS: Mapping[str, Callable[[Hooks, Any], None]] = {
    "I": _insert,
    "R": _remove,
    "U": _unlock,
    "A": lambda hooks, _: hooks.clear(),
    "X": lambda hooks, _: hooks.disable(),
}
