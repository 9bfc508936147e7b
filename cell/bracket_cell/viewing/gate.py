"""A gate before a server that asks nobody who they are: limits, and programs of this machine, not pages of other sites.

A browser says by `Host` and `Origin` whose page asks (RFC 6454); a page from elsewhere cannot change them. The server
behind listens at an address that is drawn anew for each run, so that no page can guess it.
"""

from __future__ import annotations

import asyncio
import errno
import os
import re
import secrets
import socket
import threading
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from bracket_cell.skills.drivers.settings import HOST
from bracket_cell.viewing import door
from bracket_cell.viewing.door import Caller, Door
from bracket_ground.errors import InputError, words_of

LOOPBACK = "127.0.0.1"
SOCKET = "unix:"
PLACES_N = 32  # each takes three handles: the caller's, ours to the server behind, and that server's
HEAD_BYTES = 16_384
PIECE_BYTES = 65_536
KEPT_S = 2 * door.GREETING_S  # whom the server behind has kept for so long has greeted it
STOP_S = 3.0
OWN_ORIGIN = re.compile(r"https?://(127\.0\.0\.1|localhost)(:\d{1,5})?")
EVERYWHERE = ("", "0.0.0.0", "::", "*")

Greets = Callable[[asyncio.StreamReader], Awaitable[bytes]]


class RefusedError(Exception):
    """A request that must stay outside; its text says why."""


@dataclass(frozen=True)
class Address:
    """Where a server listens.

    Attributes:
        port: 0 for any that is free.
        host: name or address that people type.
        option: of the command line, for messages.
        path: of a socket that only programs of this user reach, in place of host and port.
    """

    port: int
    host: str = LOOPBACK
    option: str = "--page"
    path: Path | None = None

    @staticmethod
    def parse(text: str, option: str) -> Address:
        """Of "PORT", "HOST:PORT" or "unix:PATH".

        Raises:
            InputError: it is none of them, or no host is named.
        """
        if text.startswith(SOCKET):
            return Address(0, option=option, path=Path(text.removeprefix(SOCKET)))
        host, colon, port = text.rpartition(":")
        if not (port.isdecimal() and int(port) <= 65535):
            raise InputError(f"{option} {text}: must be PORT or HOST:PORT, as 8780 or cell-3.local:8780")
        if colon and (host.strip("[]") in EVERYWHERE or not re.match(HOST, host.strip("[]"))):
            raise InputError(f"{option} {text}: name the host as people type it, like {socket.gethostname()}:{port}")
        return Address(int(port), host.strip("[]") or LOOPBACK, option)

    @property
    def local(self) -> bool:
        """Only programs of this machine reach it."""
        return self.host in (LOOPBACK, "localhost")

    def listening(self) -> socket.socket:
        """A socket that listens there.

        Raises:
            InputError: that cannot be.
        """
        try:
            if self.path is not None:
                return _private(self.path)
            family = socket.getaddrinfo(self.host, self.port, type=socket.SOCK_STREAM)[0][0]
            return socket.create_server((self.host, self.port), family=family)
        except OSError as error:
            where = f"port {self.port}" if self.local else f"{self.host}:{self.port}"
            where = where if self.path is None else str(self.path)
            problem = f"{where} cannot be used: {words_of(error)}; choose another with {self.option} PORT or HOST:PORT"
            raise InputError(problem) from None


def _private(path: Path) -> socket.socket:
    """A socket that only this user opens; one that nobody listens at any more is replaced."""
    with socket.socket(socket.AF_UNIX) as other:
        if other.connect_ex(str(path)) == 0:
            raise FileExistsError(errno.EADDRINUSE, "another run serves its page there")
    path.unlink(missing_ok=True)
    listening, mask = socket.socket(socket.AF_UNIX), os.umask(0o177)
    try:
        listening.bind(str(path))
        listening.listen()
    except OSError:
        listening.close()
        raise
    finally:
        os.umask(mask)
    return listening


def hidden_address() -> str:
    """One of the sixteen million addresses of the loopback network."""
    return f"127.{secrets.randbelow(255)}.{secrets.randbelow(255)}.{1 + secrets.randbelow(254)}"


def listen(port: int) -> socket.socket:
    """A socket that listens on loopback.

    Args:
        port: 0 for any that is free.

    Raises:
        OSError: the port is taken.
    """
    return socket.create_server((LOOPBACK, port))


class Gate:
    """Listens and hands on the connections that it lets in, in a thread of its own.

    Args:
        listening: a socket that listens; the gate closes it.
        behind: the server behind: address and port, or the path of a socket.
        origins: of web sites whose pages may come in, besides pages and programs of this machine.
        greets: reads what a caller must say first, and returns it; without, a request of HTTP from a permitted origin.
    """

    def __init__(
        self,
        listening: socket.socket,
        behind: tuple[str, int] | str,
        origins: Iterable[str] = (),
        greets: Greets | None = None,
    ) -> None:
        self._socket, self._behind, self._origins = listening, behind, frozenset(origins)
        self._greets = greets or self._request
        self.port: int = listening.getsockname()[1]
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
        async with Door(self._socket, self._receive, PLACES_N) as self._door:
            self._ready.set()
            await self._over.wait()

    async def _receive(self, caller: Caller) -> None:
        reader, writer = await asyncio.open_connection(sock=caller.connection, limit=HEAD_BYTES)
        async with _closed(writer):
            try:
                async with asyncio.timeout(door.GREETING_S):
                    greeting = await self._greets(reader)
            except RefusedError as refusal:
                writer.write(f"HTTP/1.1 403 Forbidden\r\nConnection: close\r\n\r\n{refusal}\n".encode())
            else:
                await self._hand_on(caller, greeting, reader, writer)

    async def _hand_on(
        self, caller: Caller, greeting: bytes, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        """A caller whom the server behind keeps for longer than a greeting may take is known."""
        if isinstance(self._behind, str):
            answers, asks = await asyncio.open_unix_connection(self._behind)
        else:
            answers, asks = await asyncio.open_connection(*self._behind)
        async with _closed(asks), asyncio.TaskGroup() as ways:
            asks.write(greeting)
            both = {ways.create_task(_pump(reader, asks)), ways.create_task(_pump(answers, writer))}
            over, _ = await asyncio.wait(both, timeout=KEPT_S, return_when=asyncio.FIRST_COMPLETED)
            if not over:
                self._door.knows(caller)
                await asyncio.wait(both, return_when=asyncio.FIRST_COMPLETED)
            for way in both:
                way.cancel()

    async def _request(self, reader: asyncio.StreamReader) -> bytes:
        """The head of a request of HTTP; raises RefusedError where it must stay outside."""
        head = await reader.readuntil(b"\r\n\r\n")
        fields = [line.partition(":") for line in head.decode("latin-1").split("\r\n")[1:] if line]
        headers = [(name.strip().lower(), value.strip()) for name, _, value in fields]
        hosts = [value for name, value in headers if name == "host"]
        if len(hosts) != 1 or hosts[0] not in {f"{name}:{self.port}" for name in (LOOPBACK, "localhost")}:
            raise RefusedError("unknown host")
        if any(self._is_foreign(value) for name, value in headers if name == "origin"):
            raise RefusedError("foreign origin")
        return head

    def _is_foreign(self, origin: str) -> bool:
        """Whether a page of another site asks, a file, or a browser's extension; `null` hides where it is from."""
        return origin not in self._origins and not OWN_ORIGIN.fullmatch(origin)


def begins(mark: bytes, size: int) -> Greets:
    """What reads the first bytes of a protocol: so many, which begin with a mark.

    Raises:
        EOFError: in what is returned, where a caller speaks another protocol.
    """

    async def greets(reader: asyncio.StreamReader) -> bytes:
        first = await reader.readexactly(size)
        if not first.startswith(mark):
            raise EOFError
        return first

    return greets


@asynccontextmanager
async def _closed(writer: asyncio.StreamWriter) -> AsyncIterator[None]:
    """At the end what was written is still sent, if it is taken in time; where it breaks off, it is closed at once."""
    try:
        yield
        writer.close()
        async with asyncio.timeout(door.GREETING_S):
            await writer.wait_closed()
    finally:
        writer.transport.abort()


async def _pump(source: asyncio.StreamReader, sink: asyncio.StreamWriter) -> None:
    """Hand on what comes until it ends; a caller that takes nothing is waited for, and so is the server behind."""
    with suppress(OSError):
        while piece := await source.read(PIECE_BYTES):
            sink.write(piece)
            await sink.drain()
