"""A controller's RTDE port that sends what a test says, byte for byte."""

from __future__ import annotations

import socket
import struct
import threading
from contextlib import suppress


def package(kind: str, body: bytes) -> bytes:
    """As it goes over the wire."""
    return struct.pack(">HB", len(body) + 3, ord(kind)) + body


class RtdeServer:
    """Answers the greeting of each client; data come from `say`.

    Attributes:
        port: where it listens.
        types: that it answers for the outputs.
    """

    def __init__(self, types: list[str]) -> None:
        self.types = types
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listening.getsockname()[1]
        self._clients: list[socket.socket] = []
        self._all: list[socket.socket] = []
        self._came = threading.Condition()
        threading.Thread(target=self._accept, daemon=True).start()

    def say(self, data: bytes, *, hang: bool = False) -> None:
        """Send it to the newest client.

        Args:
            hang: wait until that client has hung up.
        """
        self.await_connections(1)
        client = self._clients[-1]
        with suppress(OSError):
            client.sendall(data)
            client.settimeout(5.0)
            while hang and client.recv(4096):
                pass

    def await_connections(self, count: int) -> None:
        """Until so many clients have begun."""
        with self._came:
            assert self._came.wait_for(lambda: len(self._clients) >= count, 10.0)

    def close(self) -> None:
        """Hang up."""
        with suppress(OSError):
            self._listening.shutdown(socket.SHUT_RDWR)
        self._listening.close()
        for client in self._all:
            client.close()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                client, _ = self._listening.accept()
                self._all.append(client)
                threading.Thread(target=self._greet, args=(client,), daemon=True).start()

    def _greet(self, client: socket.socket) -> None:
        answers = {"V": b"\1", "v": struct.pack(">4I", 3, 15, 0, 0), "S": b"\1"}
        with suppress(OSError, struct.error):
            while True:
                size, kind = struct.unpack(">HB", client.recv(3))
                client.recv(size - 3) if size > 3 else b""
                answer = b"\1" + ",".join(self.types).encode() if chr(kind) == "O" else answers[chr(kind)]
                client.sendall(package(chr(kind), answer))
                if chr(kind) == "S":
                    with self._came:
                        self._clients.append(client)
                        self._came.notify_all()
                    return
