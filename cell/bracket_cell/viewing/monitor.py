"""A running tree for Groot2 and other monitors, over its live protocol on loopback (`cell run --open monitor`).

Requests are answered between two ticks, in the thread of the loop and without waiting, so that a run with a monitor
decides as one without; only hooks, which must be asked for, change what nodes answer.
"""

from __future__ import annotations

import json
import math
import os
import secrets
import struct
import time
import uuid
from collections.abc import Callable, Collection, Iterable, Mapping
from typing import Any

import msgpack
import zmq
from pydantic import ValidationError

from bracket_cell.recording.schemas import plain
from bracket_cell.viewing.door import GREETING_S
from bracket_cell.viewing.gate import Gate, begins, listen
from bracket_cell.viewing.stepping import WAITS
from bracket_cell.watching.observer import Observer, Outcome, TickRecord
from bracket_cell.watching.why_now import WhyNow
from bracket_ground.errors import InputError, mistakes
from btxml.engine.hooks import ORDERS, Hooks
from btxml.engine.literals import shown
from btxml.engine.node import TreeNode
from btxml.engine.tree import Tree
from btxml.files.compile.registry import Registry
from btxml.views.groot2 import StatusBoard, blackboards, tree_xml

Key = tuple[Any, Any]
DEFAULT_PORT = 1667
PROTOCOL = 2
FEEDBACK, WHY, PLACES = "F", "w", "p"  # requests of our own beside Groot2's
REQUESTS_A_TICK, SERVES_S = 16, 0.004  # so that a flood of requests does not hold up the loop: a tenth of a period
WHY_S = 0.2  # so long a reason is told again instead of being found anew: with guards asked, it takes a millisecond
SIGNATURE, SIGNATURE_BYTES = b"\xff", 10  # of ZMTP, what a peer says before it has heard anything
REQUEST_BYTES = 64 * 1024
HOOKS_REST_AFTER_S = 5.0  # of wall time without a request: nobody is there to unlock a breakpoint
AWAIT_S = 0.02
HEADER = struct.Struct("<BBI")


class Owners:
    """Which view set which hook, and when each was last heard of."""

    def __init__(self) -> None:
        self._heard_s: dict[int, float] = {}
        self._owner: dict[Key, int] = {}
        self._known: set[Key] = set()

    @property
    def viewed(self) -> bool:
        """Whether a view is there."""
        return bool(self._heard_s)

    def heard(self, session: int, view: bool) -> None:
        """A request came; a view is one that asks what only views ask."""
        if view or session in self._heard_s:
            self._heard_s[session] = time.monotonic()

    def inserted(self, session: int, hooks: Iterable[Mapping[str, Any]]) -> None:
        """All hooks that there are after a client set some: those that are new are its own."""
        keys = {key_of(hook) for hook in hooks}
        self._owner = {key: owner for key, owner in self._owner.items() if key in keys}
        if session in self._heard_s:
            self._owner |= dict.fromkeys(keys - self._known, session)
        self._known = keys

    def gone(self, silent_s: float) -> Collection[Key]:
        """Hooks of views that were not heard of for so long; they are forgotten with this."""
        now_s = time.monotonic()
        silent = {session for session, heard_s in self._heard_s.items() if now_s - heard_s > silent_s}
        if not silent:
            return ()
        found = {key for key, owner in self._owner.items() if owner in silent}
        for session in silent:
            del self._heard_s[session]
        self._owner = {key: owner for key, owner in self._owner.items() if key not in found}
        self._known -= found
        return found


def key_of(hook: Mapping[str, Any]) -> Key:
    """What tells a hook from the others."""
    return hook["uid"], hook["position"]


class RefusedError(Exception):
    """A request that cannot be answered; its text is the answer."""


class Monitor(Observer):
    """An observer that answers monitors after each tick.

    Args:
        with_hooks: let monitors put breakpoints and overrides on nodes.
        hooked: told (kind, body) of every order about hooks that was carried out; a log needs it to tick again.

    Raises:
        InputError: the port is taken.
    """

    def __init__(
        self,
        tree: Tree,
        registry: Registry,
        port: int = DEFAULT_PORT,
        with_hooks: bool = False,
        hooked: Callable[[str, Any], None] = lambda *_: None,
    ) -> None:
        self._registry = registry
        self._with_hooks = with_hooks
        self._hooked = hooked
        self._time_s = 0.0
        self._why_now = WhyNow(lambda: self._tree)
        self._asked_s = time.monotonic()
        self._context, self._gates = zmq.Context(), list[Gate]()
        self._replies = self._bound(zmq.REP, port)
        self._news = self._bound(zmq.PUB, port + 1)
        self.watch(tree)
        self._answers: dict[str, Callable[[bytes], bytes | None]] = {
            "T": lambda _: self._xml,
            "S": lambda _: self._board.statuses(),
            "B": self._blackboard,
            "r": self._record,
            "t": lambda _: self._board.take_transitions(),
            FEEDBACK: self._feedback,
            WHY: lambda _: self._told_why(),
            PLACES: lambda _: self._places,
        }

    def watch(self, tree: Tree) -> None:
        """Show this tree from now on; a monitor sees by the new identity that it must ask for the tree anew."""
        self._tree = tree
        self._identity = uuid.uuid4().bytes
        self._xml = tree_xml(tree, self._registry).encode()
        self._places = json.dumps([_place(tree, node) for node in tree.nodes]).encode()
        self._board = StatusBoard(len(tree.nodes))
        self._hooks = Hooks(tree, self._tell_breakpoint)
        self._owners = Owners()
        self._resting: list[dict[str, Any]] = []  # hooks that act again with the next request
        self._why, self._why_s = b"", -math.inf

    def tick(self, record: TickRecord) -> None:
        self._time_s = record.observation.time_s
        self._why_now.tick(record)
        self._hooks.ticked()
        self._board.update(record.changes, self._time_s)
        self.serve()

    def close(self, outcome: Outcome) -> None:  # noqa: ARG002 - monitors see the connection end
        self.abandon()

    def abandon(self) -> None:
        """Close the sockets; harmless where they are closed."""
        for gate in self._gates:
            gate.close()
        self._context.destroy(linger=0)

    def await_view(self) -> None:
        """Answer until a view looks, which then has set its breakpoints."""
        while not self._owners.viewed:
            self.serve()
            time.sleep(AWAIT_S)

    def serve(self) -> None:
        """Answer what was asked since the last time."""
        until_s = time.perf_counter() + SERVES_S
        for _ in range(REQUESTS_A_TICK):
            if time.perf_counter() > until_s:
                break
            try:
                request = self._replies.recv_multipart(zmq.NOBLOCK)
            except zmq.Again:
                break
            self._asked_s = time.monotonic()
            self._forget_gone()
            if self._resting:
                self._order("I", self._resting)
                self._resting = []
            self._replies.send_multipart(self.answer(request), zmq.NOBLOCK)
        self._forget_gone()
        if self._with_hooks and time.monotonic() - self._asked_s > HOOKS_REST_AFTER_S and self._hooks.act:
            self._resting = self._hooks.enabled
            self._order("X", {})

    def answer(self, request: list[bytes]) -> list[bytes]:
        """The frames that answer a request's frames; an error is an answer, too."""
        try:
            if len(request[0]) != HEADER.size:
                raise RefusedError(f"the header has {len(request[0])} bytes, not {HEADER.size}")
            protocol, kind, session = HEADER.unpack(request[0])
            if protocol != PROTOCOL:
                raise RefusedError(f"this is protocol {PROTOCOL}, not {protocol}")
            self._owners.heard(session, chr(kind) == FEEDBACK)
            body = self._body(chr(kind), b"".join(request[1:]))
            if chr(kind) == "I":
                self._owners.inserted(session, self._hooks.dump())
        except RefusedError as error:
            return [b"error", str(error).encode()]
        head = request[0] + self._identity
        return [head] if body is None else [head, body]

    def _body(self, kind: str, body: bytes) -> bytes | None:
        if kind in self._answers:
            return self._answers[kind](body)
        if kind not in ORDERS and kind != "D":
            raise RefusedError(f"unknown request {kind!r}; known: {' '.join([*self._answers, *ORDERS, 'D'])}")
        if not self._with_hooks:
            raise RefusedError("breakpoints and overrides are off; cell run --open breakpoints turns them on")
        if kind == "D":
            return json.dumps(self._hooks.dump()).encode()
        try:
            self._order(kind, json.loads(body) if body else {})
        except (ValidationError, ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
            raise RefusedError(mistakes(error)[0]) from None
        return None

    def _blackboard(self, names: bytes) -> bytes:
        wanted = (
            list(dict.fromkeys(names.decode(errors="replace").split(";")))
            if names
            else [scope.name or self._tree.name for scope in self._tree.scopes]
        )
        values = {
            name: {key: _packable(value) for key, value in entries.items()}
            for name, entries in blackboards(self._tree, wanted).items()
        }
        packed: bytes = msgpack.packb(values)
        return packed

    def _feedback(self, _: bytes) -> bytes:
        """What nodes say now, by uid; only `cell show --running` asks for it."""
        said = {node.uid: node.feedback_message for node in self._tree.nodes if node.feedback_message}
        said |= dict.fromkeys(self._hooks.waiting, WAITS)
        return json.dumps(said).encode()

    def _told_why(self) -> bytes:
        if time.monotonic() - self._why_s > WHY_S:
            self._why, self._why_s = json.dumps(self._why_now().plain()).encode(), time.monotonic()
        return self._why

    def _record(self, order: bytes) -> bytes | None:
        if order == b"start":
            self._board.record(self._time_s)
            return str(time.time_ns() // 1000).encode()
        if order != b"stop":
            raise RefusedError("start or stop must follow")
        self._board.stop_recording()
        return None

    def _forget_gone(self) -> None:
        """A view that was killed takes its hooks along."""
        gone = self._owners.gone(HOOKS_REST_AFTER_S)
        self._resting = [hook for hook in self._resting if key_of(hook) not in gone]
        for hook in self._hooks.dump():
            if key_of(hook) in gone:
                self._order("R", {"uid": hook["uid"], "position": hook["position"]})

    def _order(self, kind: str, body: Any) -> None:
        """Carry out an order about hooks and tell of it."""
        ORDERS[kind](self._hooks, body)
        self._hooked(kind, body)

    def _tell_breakpoint(self, uid: int) -> None:
        head = HEADER.pack(PROTOCOL, ord("N"), 0)
        self._news.send_multipart([head, str(uid).encode()], zmq.NOBLOCK)

    def _bound(self, kind: int, port: int) -> zmq.Socket[bytes]:
        """A socket behind a gate at a port."""
        try:
            listening = listen(port)
        except OSError as error:
            self.abandon()
            raise InputError(
                f"port {port} cannot be used: {error.strerror}; choose another with --open monitor=PORT"
            ) from None
        socket, name = self._context.socket(kind), f"cell-monitor-{secrets.token_hex(16)}"
        socket.setsockopt(zmq.MAXMSGSIZE, REQUEST_BYTES)
        socket.setsockopt(zmq.RCVHWM, REQUESTS_A_TICK)
        socket.setsockopt(zmq.HANDSHAKE_IVL, round(1e3 * GREETING_S))
        socket.setsockopt(zmq.IPC_FILTER_UID, os.getuid())  # others of this machine come by the gate, too
        socket.bind(f"ipc://@{name}")
        self._gates.append(Gate(listening, f"\0{name}", greets=begins(SIGNATURE, SIGNATURE_BYTES)))
        return socket


def _place(tree: Tree, node: TreeNode) -> list[str | int]:
    """File and line in which a node stands; an empty name where it was made in Python."""
    place = tree.places[node.uid - 1].get("") if node.uid <= len(tree.places) else None
    return ["", 0] if place is None else [str(place.file.resolve()), place.line or 0]


def _packable(value: object) -> Any:
    """What msgpack can hold of an entry: plain data, or its text."""
    try:
        found = plain(value)
        msgpack.packb(found)
    except (TypeError, ValueError, OverflowError, RecursionError):
        return shown(value) if isinstance(value, int) else str(value).encode(errors="replace").decode()
    return found
