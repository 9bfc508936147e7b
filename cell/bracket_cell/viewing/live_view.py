"""A running tree on the terminal: a client of Groot2's live protocol (`cell show --running`)."""

from __future__ import annotations

import json
import os
import re
import secrets
import select
import struct
import sys
import termios
import time
import tty
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any
from xml.etree import ElementTree

import msgpack
import zmq
from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from bracket_cell.viewing.stepping import Stepper
from bracket_cell.viewing.tree_lines import Line, fitted, lines_of
from bracket_ground.errors import InputError

HEADER = struct.Struct("<BBI")
STATUS = struct.Struct("<HB")
PROTOCOL = 2
TIMEOUT_MS = 2000
REFRESH_S = 0.2
FEEDBACK, WHY, PLACES = "F", "w", "p"
WAIT_S = 600.0  # for a run to begin
ARROWS = {"\x1b[A": -1, "\x1b[B": 1, "\x1b[5~": -10, "\x1b[6~": 10, "k": -1, "j": 1}
KEY = re.compile(r"\x1b\[[0-9]*[A-Z~]|.", re.DOTALL)


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
            feedback: dict[str, str] = json.loads(self._ask(FEEDBACK))
        except InputError:
            return {}
        return {int(uid): text for uid, text in feedback.items()}

    def places(self) -> list[tuple[str, int]]:
        """File and line of every node, in the order of the uids.

        Raises:
            InputError: the monitor is of another program, which does not know.
        """
        return [(file, line) for file, line in json.loads(self._ask(PLACES))]

    def why(self) -> str:
        """Why the robot does what it does, in one sentence; a monitor of another program does not know."""
        try:
            reasons: dict[str, str] = json.loads(self._ask(WHY))
        except InputError:
            return ""
        return reasons["text"] + (f"; otherwise {reasons['otherwise']}" if reasons["otherwise"] else "")

    def awaited(self, wait_s: float, waits: Callable[[], object]) -> ElementTree.Element:
        """The tree of a run, which may begin within some time.

        Args:
            waits: called once where nothing answers yet.

        Raises:
            InputError: it did not begin.
        """
        until_s, shown = time.monotonic() + wait_s, False
        while True:
            try:
                return self.tree()
            except InputError:
                if time.monotonic() >= until_s:
                    raise
                if not shown:
                    waits()
                shown = True

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
            raise InputError(f"nothing answers on port {self._port}; start `cell run --open monitor` first") from None
        if head == b"error":
            raise InputError(f"the monitor refuses: {b''.join(bodies).decode(errors='replace')}")
        self.identity = head[HEADER.size :]
        return b"".join(bodies)


class Screen:
    """What the person wants to see: what runs, or the whole tree, how far scrolled; and a name that is typed."""

    def __init__(self) -> None:
        self.whole = False
        self.first: int | None = None  # row that is shown first; None follows what runs
        self.typing: str | None = None

    def press(self, key: str) -> str:
        """Take a key that is about the screen; a name that was typed to its end, else empty."""
        if self.typing is not None:
            if key in "\r\n":
                name, self.typing = self.typing, None
                return name
            self.typing = None if key == "\x1b" else self.typing[:-1] if key in "\x7f\b" else self.typing + key
        elif key == "b":
            self.typing = ""
        elif key == "t":
            self.whole, self.first = not self.whole, None
        elif key in ARROWS:
            self.first = max(0, (self.first or 0) + ARROWS[key])
        elif key == "f":
            self.first = None
        return ""

    def rows(self, lines: Sequence[Line], rows: int) -> list[Text]:
        """At most so many rows of these lines."""
        wanted = list(lines) if self.whole else [line for line in lines if line.acts]
        if self.first is None:
            return fitted(wanted, rows) if self.whole else [line.flat() for line in wanted[:rows]]
        self.first = min(self.first, max(0, len(wanted) - rows))
        return [line.text() if self.whole else line.flat() for line in wanted[self.first : self.first + rows]]


def live_view(port: int, console: Console, wait_s: float = WAIT_S) -> None:
    """Show a running tree until it ends or the person leaves; keys pause it and let it go on step by step.

    Raises:
        InputError: no run began in time.
    """
    client, screen = MonitorClient(port), Screen()
    stepper: Stepper | None = None
    try:
        waits = f"waits for `cell run --open monitor` on port {port}; Ctrl-C leaves"
        xml = client.awaited(wait_s, lambda: console.print(waits))
        shown = client.identity
        stepper = Stepper(xml, client.order)
        with keys() as pressed, Live(console=console, auto_refresh=False, screen=console.is_terminal) as live:
            while True:
                try:
                    said, entries, statuses, why = client.said(), client.blackboards(), client.statuses(), client.why()
                    if client.identity != shown:
                        xml, shown = client.tree(), client.identity
                        stepper = Stepper(xml, client.order)
                        continue
                except InputError:
                    stepper = None
                    console.print("the run has ended")
                    break
                stepper.keep(statuses, said)
                size = (console.width, console.height - 2)
                drawn = view(xml, statuses, entries, said, size, screen if console.is_terminal else None)
                footer = (Text(why, "bold", no_wrap=True, overflow="ellipsis"), _footer(stepper, screen))
                live.update(Group(drawn, *footer) if console.is_terminal else Group(Text(why), drawn), refresh=True)
                if not _obey(pressed.pressed(REFRESH_S), screen, stepper, said):
                    break
    finally:
        if stepper is not None:
            stepper.leave()
        client.close()


def _obey(typed: str, screen: Screen, stepper: Stepper, said: Mapping[int, str]) -> bool:
    """What the keys of the last moments mean; False where the person leaves."""
    for key in KEY.findall(typed):
        if key == "q" and screen.typing is None:
            return False
        typing = screen.typing is not None
        if name := screen.press(key):
            stepper.stop_at(name)
        elif not typing:
            stepper.press(key, said)
    return True


def _footer(stepper: Stepper, screen: Screen) -> Text:
    if screen.typing is not None:
        return Text(f"waits before which node? {screen.typing}_   Enter: yes, Esc: no", style="bold")
    keys = f"p {'goes on' if stepper.paused else 'pauses'}   s steps   b NAME breaks there   "
    keys += f"t {'what runs' if screen.whole else 'whole tree'}   ↑↓ scroll, f follows   q leaves"
    return Text(f"{keys}   {stepper.message}", style="dim", no_wrap=True, overflow="ellipsis")


def view(
    xml: ElementTree.Element,
    statuses: Mapping[int, int],
    entries: Mapping[str, Any],
    said: Mapping[int, str] | None = None,
    size: tuple[int, int] = (80, 1000),
    screen: Screen | None = None,
) -> Group:
    """The tree with its statuses and why nodes wait, and the blackboards below.

    Args:
        screen: what of the tree is shown; all of it by default.
        size: of the window in columns and rows; what runs is always shown, the blackboard in a third of the rows.
    """
    columns, rows = size
    lines = lines_of(xml, statuses, said or {})
    values = [(tree, key, value) for tree, own in entries.items() for key, value in (own or {}).items()]
    board_rows = min(len(values), max(rows - 3 - len(lines), rows // 3 - 2))
    texts = fitted(lines, rows - board_rows - 3) if screen is None else screen.rows(lines, rows - board_rows - 3)
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
