"""The twin's own door: `cell twin fault NAME` and `cell twin report` reach a running twin by a socket file."""

from __future__ import annotations

import json
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from bracket_ground.errors import CellError, InputError, words_of
from bracket_sim.twin.cell import TwinCell
from bracket_sim.twin.sockets import Port

ADDRESS = Path("runs/twin.sock")
ANSWER_S = 10.0
LONGEST = 65536


class ControlDoor(Port):
    """Takes one order a connection: `{"fault": NAME}`, `{"faults": true}` or `{"report": true}`."""

    def __init__(self, cell: TwinCell, address: Path) -> None:
        self._cell, self._address = cell, address
        if address.is_socket() and not _answers(address):
            address.unlink()
        with suppress(OSError):  # what follows says why
            address.parent.mkdir(0o700, parents=True, exist_ok=True)
        super().__init__(address)
        address.chmod(0o600)

    def close(self) -> None:
        """Nobody is let in any more."""
        super().close()
        self._address.unlink(missing_ok=True)

    def serve(self, client: socket.socket) -> None:
        """Take an order, and answer."""
        client.settimeout(1.0)
        client.sendall(json.dumps(self._answer(json.loads(client.recv(LONGEST)))).encode())

    def _answer(self, order: dict[str, Any]) -> dict[str, Any]:
        try:
            if "fault" in order:
                return {"told": self._cell.fault(str(order["fault"]))}
            if "faults" in order:
                return {"told": {name: fault.what for name, fault in sorted(self._cell.faults.items())}}
            with self._cell.lock:
                return {"told": self._cell.sim.report() | {"time_s": self._cell.now_s(), "lost_s": self._cell.lost_s}}
        except CellError as error:
            return {"error": str(error)}


def ask(address: Path, order: dict[str, Any]) -> Any:
    """Let a running twin do something, and take its answer.

    Raises:
        InputError: no twin is there, or it refuses.
    """
    try:
        with _connected(address) as connection:
            connection.sendall(json.dumps(order).encode())
            answer = json.loads(b"".join(iter(lambda: connection.recv(LONGEST), b"")))
    except (OSError, ValueError) as error:
        raise InputError(f"{address}: no twin answers there: {words_of(error)}; start one by `cell twin`") from None
    if "error" in answer:
        raise InputError(answer["error"])
    return answer["told"]


@contextmanager
def _connected(address: Path) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_UNIX) as connection:
        connection.settimeout(ANSWER_S)
        connection.connect(str(address))
        yield connection


def _answers(address: Path) -> bool:
    try:
        with _connected(address):
            return True
    except OSError:
        return False
