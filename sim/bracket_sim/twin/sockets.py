"""A place where clients come, each with a thread of its own: a port, or a socket file."""

from __future__ import annotations

import socket
import threading
from contextlib import suppress
from pathlib import Path

from bracket_ground.errors import InputError


class Port:
    """Listens; subclasses serve a client.

    Attributes:
        port: its number; 0 for a file.

    Raises:
        InputError: the address cannot be had.
    """

    def __init__(self, host: str | Path, port: int = 0) -> None:
        self.clients: set[socket.socket] = set()
        file = isinstance(host, Path)
        self._listener = socket.socket(socket.AF_UNIX if file else socket.AF_INET)
        self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            self._listener.bind(str(host) if file else (host, port))
        except OSError as error:
            self._listener.close()
            where = host if file else f"{host}:{port}"
            raise InputError(f"{where}: the twin cannot listen there: {error.strerror or error}") from None
        self._listener.listen(8)
        self.port: int = 0 if file else self._listener.getsockname()[1]
        threading.Thread(target=self._accept, name=f"port {port}", daemon=True).start()

    def close(self) -> None:
        """Nobody is served any more."""
        with suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self.cut()

    def cut(self) -> None:
        """All clients are cut off; they may come again."""
        for client in list(self.clients):
            with suppress(OSError):
                client.shutdown(socket.SHUT_RDWR)

    def serve(self, client: socket.socket) -> None:
        """Talk to one client until it is gone; runs in a thread of its own."""
        raise NotImplementedError

    def _accept(self) -> None:
        while True:
            try:
                client, _ = self._listener.accept()
            except OSError:
                return
            if client.family == socket.AF_INET:
                client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            threading.Thread(target=self._serve, args=(client,), daemon=True).start()

    def _serve(self, client: socket.socket) -> None:
        self.clients.add(client)
        with client, suppress(OSError, EOFError, ValueError):
            self.serve(client)
        self.clients.discard(client)
