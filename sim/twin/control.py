"""The twin's own door: `cell twin fault NAME` and `cell twin report` reach a running twin by a socket file."""

from __future__ import annotations

import json
import socket
import threading
from contextlib import suppress
from pathlib import Path
from typing import Any

from cell.errors import CellError, InputError
from sim.twin.cell import TwinCell

ADDRESS = Path("runs/twin.sock")
ANSWER_S = 10.0
LONGEST = 65536


class ControlDoor:
    """Takes one order a connection: `{"fault": NAME}`, `{"faults": true}` or `{"report": true}`.

    Raises:
        InputError: the address cannot be had.
    """

    def __init__(self, cell: TwinCell, address: Path) -> None:
        self._cell, self._address = cell, address
        self._listener = socket.socket(socket.AF_UNIX)
        try:
            if address.is_socket() and not _answers(address):
                address.unlink()
            address.parent.mkdir(0o700, parents=True, exist_ok=True)
            self._listener.bind(str(address))
            address.chmod(0o600)
        except OSError as error:
            self._listener.close()
            raise InputError(f"{address}: the twin cannot listen there: {error.strerror or error}") from None
        self._listener.listen(4)
        threading.Thread(target=self._serve, name="control", daemon=True).start()

    def close(self) -> None:
        """Nobody is let in any more."""
        with suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self._address.unlink(missing_ok=True)

    def _serve(self) -> None:
        while True:
            try:
                taken, _ = self._listener.accept()
            except OSError:
                return
            with taken, suppress(OSError, ValueError):
                taken.settimeout(1.0)
                order = json.loads(taken.recv(LONGEST))
                taken.sendall(json.dumps(self._answer(order)).encode())

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
    with socket.socket(socket.AF_UNIX) as connection:
        connection.settimeout(ANSWER_S)
        try:
            connection.connect(str(address))
            connection.sendall(json.dumps(order).encode())
            answer = json.loads(b"".join(iter(lambda: connection.recv(LONGEST), b"")))
        except (OSError, ValueError) as error:
            raise InputError(f"{address}: no twin answers there: {error}; start one by `cell twin`") from None
    if "error" in answer:
        raise InputError(answer["error"])
    return answer["told"]


def _answers(address: Path) -> bool:
    with socket.socket(socket.AF_UNIX) as trial:
        trial.settimeout(1.0)
        try:
            trial.connect(str(address))
        except OSError:
            return False
    return True
