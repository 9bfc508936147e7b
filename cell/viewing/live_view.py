"""A running tree on the terminal: a client of Groot2's live protocol (`cell monitor`)."""

from __future__ import annotations

import json
import os
import secrets
import select
import struct
import sys
import termios
import tty
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any
from xml.etree import ElementTree

import msgpack
import zmq
from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from cell.errors import InputError
from cell.viewing.stepping import Stepper
from cell.viewing.tree_lines import fitted, lines_of

HEADER = struct.Struct("<BBI")
STATUS = struct.Struct("<HB")
PROTOCOL = 2
TIMEOUT_MS = 2000
REFRESH_S = 0.2
FEEDBACK = "F"


class Keys:
    """What was pressed since it was last asked.

    Args:
        descriptor: of the terminal; None where there is none.
    """

    def __init__(self, descriptor: int | None) -> None:
        self._descriptor = descriptor

    def pressed(self, within_s: float) -> str:
        """The keys of the next moments; empty where there is no terminal, after the same time."""
        waits = [] if self._descriptor is None else [self._descriptor]
        ready, _, _ = select.select(waits, [], [], within_s)
        return os.read(self._descriptor, 64).decode(errors="ignore") if ready and self._descriptor is not None else ""


@contextmanager
def keys() -> Iterator[Keys]:
    """Take single keys from standard input for a while."""
    if not sys.stdin.isatty():
        yield Keys(None)
        return
    descriptor = sys.stdin.fileno()
    before = termios.tcgetattr(descriptor)
    tty.setcbreak(descriptor)
    try:
        yield Keys(descriptor)
    finally:
        termios.tcsetattr(descriptor, termios.TCSADRAIN, before)


class MonitorClient:
    """Asks one monitor on this machine.

    Attributes:
        identity: of the tree that answered last; another one means that the tree was exchanged.
    """

    def __init__(self, port: int) -> None:
        self.identity = b""
        self._port = port
        self._session = secrets.randbits(32)  # tells this client from others: its hooks end with it
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.REQ)
        self._socket.setsockopt(zmq.RCVTIMEO, TIMEOUT_MS)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.setsockopt(zmq.REQ_RELAXED, 1)  # it may ask on after a request that nobody answered,
        self._socket.setsockopt(zmq.REQ_CORRELATE, 1)  # and a late answer is not taken for that of the next one
        self._socket.connect(f"tcp://127.0.0.1:{port}")

    def tree(self) -> ElementTree.Element:
        """The tree with its uids."""
        return ElementTree.fromstring(self._ask("T").decode())

    def statuses(self) -> dict[int, int]:
        """Numbers of the statuses by uid."""
        return dict(STATUS.iter_unpack(self._ask("S")))

    def blackboards(self) -> dict[str, Any]:
        """Entries of all trees, by tree."""
        found: dict[str, Any] = msgpack.unpackb(self._ask("B"))
        return found

    def said(self) -> dict[int, str]:
        """Why nodes wait, or how they ended, by uid; a monitor of another program knows nothing of that."""
        try:
            told: dict[str, str] = json.loads(self._ask(FEEDBACK))
        except InputError:
            return {}
        return {int(uid): text for uid, text in told.items()}

    def order(self, kind: str, body: bytes) -> None:
        """Order something about hooks.

        Raises:
            InputError: they are off, or it means no node.
        """
        self._ask(kind, body)

    def close(self) -> None:
        """Hang up."""
        self._context.destroy(linger=0)

    def _ask(self, kind: str, body: bytes = b"") -> bytes:
        """The body of an answer.

        Raises:
            InputError: there is no answer, or a refusal.
        """
        head = HEADER.pack(PROTOCOL, ord(kind), self._session)
        self._socket.send_multipart([head, body] if body else [head])
        try:
            head, *bodies = self._socket.recv_multipart()
        except zmq.Again:
            raise InputError(f"nothing answers on port {self._port}; start `cell run --monitor` first") from None
        if head == b"error":
            raise InputError(f"the monitor refuses: {b''.join(bodies).decode(errors='replace')}")
        self.identity = head[HEADER.size :]
        return b"".join(bodies)


def live_view(port: int, console: Console) -> None:
    """Show a running tree until it ends or the person leaves; keys pause it and let it go on step by step.

    Raises:
        InputError: there is no first answer.
    """
    client = MonitorClient(port)
    stepper: Stepper | None = None
    try:
        xml, shown = client.tree(), client.identity
        stepper = Stepper(xml, client.order)
        with keys() as pressed, Live(console=console, auto_refresh=False, screen=console.is_terminal) as live:
            while True:
                try:
                    said, entries, statuses = client.said(), client.blackboards(), client.statuses()
                    if client.identity != shown:
                        xml, shown = client.tree(), client.identity
                        stepper = Stepper(xml, client.order)
                        continue
                except InputError:
                    stepper = None
                    console.print("the run has ended")
                    break
                stepper.keep(statuses, said)
                drawn = view(xml, statuses, entries, said, (console.width, console.height - 1))
                live.update(Group(drawn, _footer(stepper)) if console.is_terminal else drawn, refresh=True)
                typed = pressed.pressed(REFRESH_S)
                if "q" in typed:
                    break
                for key in typed:
                    stepper.press(key, said)
    finally:
        if stepper is not None:
            stepper.leave()
        client.close()


def _footer(stepper: Stepper) -> Text:
    return Text(f"p {'goes on' if stepper.paused else 'pauses'}   s steps   q leaves   {stepper.told}", style="dim")


def view(
    xml: ElementTree.Element,
    statuses: Mapping[int, int],
    entries: Mapping[str, Any],
    said: Mapping[int, str] | None = None,
    size: tuple[int, int] = (80, 1000),
) -> Group:
    """The tree with its statuses and why nodes wait, and the blackboards below.

    Args:
        size: of the window in columns and rows; what runs is always shown, the blackboard in a third of the rows.
    """
    columns, rows = size
    lines = lines_of(xml, statuses, said or {})
    values = [(tree, key, value) for tree, own in entries.items() for key, value in (own or {}).items()]
    board_rows = min(len(values), max(rows - 3 - len(lines), rows // 3 - 2))
    texts = fitted(lines, rows - board_rows - 3)
    for text in texts:
        text.truncate(columns, overflow="ellipsis")
    title = Text(next(xml.iter("BehaviorTree")).get("ID", ""), style="bold")
    return Group(title, *texts, _entries_table(values, board_rows, columns))


def _entries_table(values: Sequence[tuple[str, str, Any]], rows: int, columns: int) -> Table:
    left_out = len(values) - rows
    title = "blackboard" + (f" ({left_out} more)" if left_out > 0 else "")
    table = Table(title=title, title_justify="left", show_header=False, box=None, padding=(0, 1))
    for _ in range(3):
        table.add_column(no_wrap=True, overflow="ellipsis")
    third = max(columns // 3 - 2, 1)
    for tree, key, value in values[:rows]:
        place = Text(tree if len(tree) <= third else f"…{tree[1 - third :]}")  # the inner tree says more
        name, text = Text(key), Text(str(value)[:columns])
        name.truncate(third, overflow="ellipsis")
        text.truncate(third, overflow="ellipsis")
        table.add_row(place, name, text)
    return table
