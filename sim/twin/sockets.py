"""A port with a thread for each client."""

from __future__ import annotations

import socket
import threading
from contextlib import suppress

from cell.errors import InputError


class Port:
    """Listens at a port; subclasses serve a client.

    Attributes:
        port: its number.

    Raises:
        InputError: the port is taken.
    """

    def __init__(self, host: str, port: int) -> None:
        self.clients: set[socket.socket] = set()
        self._listener = socket.socket()
        self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            self._listener.bind((host, port))
        except OSError as error:
            self._listener.close()
            raise InputError(f"{host}:{port} cannot be served: {error.strerror or error}") from None
        self._listener.listen(8)
        self.port: int = self._listener.getsockname()[1]
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
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            threading.Thread(target=self._serve, args=(client,), daemon=True).start()

    def _serve(self, client: socket.socket) -> None:
        self.clients.add(client)
        with client, suppress(OSError, EOFError):
            self.serve(client)
        self.clients.discard(client)
