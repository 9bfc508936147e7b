"""A line between two programs that can be pulled: bytes wait on both ends, as where a network is gone."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress

CHUNK = 65536


class Cable:
    """Listens on a port and is connected to another of this machine.

    Attributes:
        port: where a client connects.
        carried: chunks that came through, in both directions.
    """

    def __init__(self, to_port: int) -> None:
        self._to, self._whole, self._over = ("127.0.0.1", to_port), threading.Event(), threading.Event()
        self._whole.set()
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listening.getsockname()[1]
        self.carried = 0
        threading.Thread(target=self._accept, daemon=True).start()

    def pull(self) -> None:
        """Carry nothing."""
        self._whole.clear()

    def plug(self) -> None:
        """Carry again, and what waited first."""
        self._whole.set()

    def close(self) -> None:
        """End all lines."""
        self._over.set()
        self._whole.set()
        self._listening.shutdown(socket.SHUT_RDWR)  # wakes who waits there
        self._listening.close()

    def _accept(self) -> None:
        while not self._over.is_set():
            try:
                near, _ = self._listening.accept()
            except OSError:
                return
            threading.Thread(target=self._connect, args=(near,), daemon=True).start()

    def _connect(self, near: socket.socket) -> None:
        self._whole.wait()
        try:
            far = socket.create_connection(self._to)
        except OSError:
            near.close()
            return
        for ends in ((near, far), (far, near)):
            threading.Thread(target=self._carry, args=ends, daemon=True).start()

    def _carry(self, begin: socket.socket, end: socket.socket) -> None:
        """One direction, until an end closes it."""
        with suppress(OSError), begin, end:
            while chunk := begin.recv(CHUNK):
                self._whole.wait()
                end.sendall(chunk)
                self.carried += 1


@contextmanager
def cable(to_port: int) -> Iterator[Cable]:
    """A cable that is taken away at the end."""
    made = Cable(to_port)
    try:
        yield made
    finally:
        made.close()
