"""A gate before a server that asks nobody who they are: it lets in programs of this machine, not pages of other sites.

A browser says by `Host` and `Origin` whose page asks (RFC 6454); a page from elsewhere cannot change them. The server
behind listens at an address that is drawn anew for each run, so that no page can guess it.
"""

from __future__ import annotations

import asyncio
import contextlib
import secrets
import socket
import threading
from collections.abc import Iterable
from dataclasses import dataclass
from urllib.parse import urlsplit

from cell.errors import InputError

LOOPBACK = "127.0.0.1"
CONNECTIONS_N = 32
HEAD_S, HEAD_BYTES = 5.0, 16_384  # for a caller to say what it wants
PIECE_BYTES = 65_536
STOP_S = 3.0
EVERYWHERE = ("", "0.0.0.0", "::", "*")


@dataclass(frozen=True)
class Address:
    """Where a server listens.

    Attributes:
        port: 0 for any that is free.
        host: name or address that people type.
        option: of the command line, for messages.
    """

    port: int
    host: str = LOOPBACK
    option: str = "--page"

    @staticmethod
    def parse(text: str, option: str) -> Address:
        """Of "PORT" or "HOST:PORT".

        Raises:
            InputError: it is neither, or no host is named.
        """
        host, colon, port = text.rpartition(":")
        if not (port.isdecimal() and int(port) <= 65535):
            raise InputError(f"{option} {text}: must be PORT or HOST:PORT, as 8780 or cell-3.local:8780")
        if colon and host.strip("[]") in EVERYWHERE:
            raise InputError(f"{option} {text}: name the host as people type it, like {socket.gethostname()}:{port}")
        return Address(int(port), host.strip("[]") or LOOPBACK, option)

    @property
    def local(self) -> bool:
        """Only programs of this machine reach it."""
        return self.host in (LOOPBACK, "localhost")

    def listening(self, backlog: int) -> socket.socket:
        """A socket that listens there.

        Raises:
            InputError: that cannot be.
        """
        try:
            family = socket.getaddrinfo(self.host, self.port, type=socket.SOCK_STREAM)[0][0]
            return socket.create_server((self.host, self.port), family=family, backlog=backlog)
        except OSError as error:
            where = f"port {self.port}" if self.local else f"{self.host}:{self.port}"
            problem = f"{where} cannot be used: {error.strerror}; choose another with {self.option} PORT or HOST:PORT"
            raise InputError(problem) from None


def hidden_address() -> str:
    """One of the sixteen million addresses of the loopback network."""
    return f"127.{secrets.randbelow(255)}.{secrets.randbelow(255)}.{1 + secrets.randbelow(254)}"


class Gate:
    """Listens on loopback and hands on the connections that it lets in, in a thread of its own.

    Args:
        listening: a socket that listens; the gate closes it.
        behind: address and port of the server behind.
        origins: of web sites whose pages may come in, besides pages and programs of this machine.
    """

    def __init__(self, listening: socket.socket, behind: tuple[str, int], origins: Iterable[str]) -> None:
        self._socket, self._behind, self._origins = listening, behind, frozenset(origins)
        self.port: int = listening.getsockname()[1]
        self._open = 0
        self._loop: asyncio.AbstractEventLoop | None = None
        self._over = asyncio.Event()
        self._ready = threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._serve()), name="gate", daemon=True)
        self._thread.start()
        self._ready.wait(STOP_S)

    def close(self) -> None:
        """End, and hang up on everybody; harmless when repeated."""
        if self._loop is not None and self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._over.set)
            self._thread.join(STOP_S)

    async def _serve(self) -> None:
        self._loop = asyncio.get_running_loop()
        server = await asyncio.start_server(self._come, sock=self._socket, limit=HEAD_BYTES)
        self._ready.set()
        await self._over.wait()
        server.close()

    async def _come(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._open += 1
        try:
            if self._open <= CONNECTIONS_N:
                await self._hand_on(reader, writer)
        except (OSError, TimeoutError, asyncio.IncompleteReadError, asyncio.LimitOverrunError):
            return  # the caller said nothing, too much or no more, or the server behind has ended
        finally:
            self._open -= 1
            writer.close()

    async def _hand_on(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        async with asyncio.timeout(HEAD_S):
            head = await reader.readuntil(b"\r\n\r\n")
        if refusal := self._refusal(head):
            writer.write(f"HTTP/1.1 403 Forbidden\r\nConnection: close\r\n\r\n{refusal}\n".encode())
            await writer.drain()
            return
        answers, asks = await asyncio.open_connection(*self._behind)
        try:
            asks.write(head)
            ways = [asyncio.ensure_future(_pump(reader, asks)), asyncio.ensure_future(_pump(answers, writer))]
            await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
            for way in ways:
                way.cancel()
        finally:
            asks.close()

    def _refusal(self, head: bytes) -> str:
        """Why this request stays outside; empty for one that comes in."""
        fields = [line.partition(":") for line in head.decode("latin-1").split("\r\n")[1:] if line]
        told = [(name.strip().lower(), value.strip()) for name, _, value in fields]
        hosts = [value for name, value in told if name == "host"]
        if len(hosts) != 1 or hosts[0] not in {f"{name}:{self.port}" for name in (LOOPBACK, "localhost")}:
            return "unknown host"
        origins = [value for name, value in told if name == "origin"]
        return "foreign origin" if any(map(self._is_foreign, origins)) else ""

    def _is_foreign(self, origin: str) -> bool:
        """Whether a page of another site asks; `null` is what a browser says of a page that hides where it is from."""
        asks = urlsplit(origin)
        if asks.scheme in ("http", "https"):
            return origin not in self._origins and asks.hostname not in (LOOPBACK, "localhost")
        return "://" not in origin  # the desktop viewers are files or apps


async def _pump(source: asyncio.StreamReader, sink: asyncio.StreamWriter) -> None:
    """Hand on what comes until it ends; a caller that takes nothing is waited for, and so is the server behind."""
    with contextlib.suppress(OSError):
        while piece := await source.read(PIECE_BYTES):
            sink.write(piece)
            await sink.drain()


def listen(port: int) -> socket.socket:
    """A socket that listens on loopback.

    Args:
        port: 0 for any that is free.

    Raises:
        OSError: the port is taken.
    """
    listening = socket.socket()
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((LOOPBACK, port))
        listening.listen(CONNECTIONS_N)
    except OSError:
        listening.close()
        raise
    return listening
