"""A running tree on the terminal: a client of Groot2's live protocol (`cell monitor`)."""

from __future__ import annotations

import struct
import time
from collections.abc import Mapping
from typing import Any
from xml.etree import ElementTree

import msgpack
import zmq
from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text
from rich.tree import Tree as Branch

from cell.interfaces.errors import InputError

HEADER = struct.Struct("<BBI")
STATUS = struct.Struct("<HB")
PROTOCOL = 2
TIMEOUT_MS = 2000
REFRESH_S = 0.2
VALUE_LETTERS = 80
# By the protocol's numbers; 10 and more is what a node was before it went idle.
MARKS = {0: ("·", "dim"), 1: ("▶", "bold yellow"), 2: ("✔", "green"), 3: ("✘", "red"), 4: ("-", "dim")}


class MonitorClient:
    """Asks one monitor on this machine.

    Attributes:
        identity: of the tree that answered last; another one means that the tree was exchanged.
    """

    def __init__(self, port: int) -> None:
        self.identity = b""
        self._port = port
        self._count = 0
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.REQ)
        self._socket.setsockopt(zmq.RCVTIMEO, TIMEOUT_MS)
        self._socket.setsockopt(zmq.LINGER, 0)
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

    def close(self) -> None:
        """Hang up."""
        self._context.destroy(linger=0)

    def _ask(self, kind: str) -> bytes:
        """The body of an answer.

        Raises:
            InputError: nobody answers, or refuses to.
        """
        self._count += 1
        self._socket.send(HEADER.pack(PROTOCOL, ord(kind), self._count))
        try:
            head, *bodies = self._socket.recv_multipart()
        except zmq.Again:
            raise InputError(f"nobody answers on port {self._port}; start `cell run --monitor` first") from None
        if head == b"error":
            raise InputError(f"the monitor refuses: {b''.join(bodies).decode(errors='replace')}")
        self.identity = head[HEADER.size :]
        return b"".join(bodies)


def live_view(port: int, console: Console) -> None:
    """Show a running tree until it ends or the person leaves.

    Raises:
        InputError: nobody answers at first.
    """
    client = MonitorClient(port)
    try:
        xml, shown = client.tree(), client.identity
        with Live(console=console, auto_refresh=False, screen=console.is_terminal) as live:
            while True:
                try:
                    statuses, entries = client.statuses(), client.blackboards()
                    if client.identity != shown:
                        xml, shown = client.tree(), client.identity
                        continue
                except InputError:
                    break
                live.update(view(xml, statuses, entries), refresh=True)
                time.sleep(REFRESH_S)
        console.print("the run has ended")
    finally:
        client.close()


def view(xml: ElementTree.Element, statuses: Mapping[int, int], entries: Mapping[str, Any]) -> Group:
    """The tree with its statuses, and the blackboards below."""
    trees = {element.get("_fullpath", ""): element for element in xml.iter("BehaviorTree")}
    main = trees[""]
    branch = Branch(Text(main.get("ID", ""), style="bold"))
    waiting = [(branch, child) for child in reversed(main)]
    while waiting:
        above, element = waiting.pop()
        mark, style = MARKS[statuses.get(int(element.get("_uid", "0")), 0) % 10]
        label = element.get("name") or element.tag
        kind = element.get("ID", element.tag)
        below = above.add(Text(f"{mark} {label}" if label == kind else f"{mark} {label}  ({kind})", style=style))
        inner = trees[element.get("_fullpath", "")] if element.tag == "SubTree" else element
        waiting += [(below, child) for child in reversed(inner)]
    return Group(branch, _entries_table(entries))


def _entries_table(entries: Mapping[str, Any]) -> Table:
    table = Table(title="blackboard", title_justify="left", show_header=False)
    for tree, values in entries.items():
        for key, value in (values or {}).items():
            text = str(value)
            text = text if len(text) <= VALUE_LETTERS else text[: VALUE_LETTERS - 3] + "..."
            table.add_row(Text(tree), Text(key), Text(text))
    return table
