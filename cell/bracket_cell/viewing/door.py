"""Where callers of a server come in: so many at once and no more, and a flood of strangers keeps nobody out."""

from __future__ import annotations

import asyncio
import resource
import socket
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Any

PLACES_N = 64  # connections of one door, with the bodies of requests some megabytes
GREETING_S = 5.0  # for a caller to say what it wants; a viewer on a busy machine takes a tenth of it
RUNS_SHARE = 0.5  # of the handles that this process may open: kept free for log, cameras and processes
NO_HANDLE_S = 0.1  # between two attempts to accept where no handle is left

Receive = Callable[["Caller"], Awaitable[None]]
GONE = (OSError, TimeoutError, EOFError, asyncio.LimitOverrunError)  # the caller said nothing, too much or no more


class Caller:
    """A connection that was accepted.

    Attributes:
        known: it showed that it may come in, and keeps its place.
    """

    def __init__(self, connection: socket.socket) -> None:
        self.connection, self.known, self._served = connection, False, False

    async def serve(self, receive: Receive) -> None:
        """Until the connection is over."""
        self._served = True
        with suppress(*GONE):
            await receive(self)

    def left(self) -> None:
        """It is over; who serves it closes it, but where that was cancelled before it began."""
        if not self._served:
            self.connection.close()


class Door:
    """Accepts connections and closes them: an asynchronous context, whose end hangs up on everybody.

    Half of the places are for callers that are known, see `knows`. Of all others the oldest makes room for a newcomer;
    so who only opens connections, before any token, keeps nobody with a token outside.

    Args:
        listening: a socket that listens; the door closes it.
        receive: serves a caller and closes its connection; cancelled, at once.
        places_n: connections at most.
    """

    def __init__(self, listening: socket.socket, receive: Receive, places_n: int = PLACES_N) -> None:
        self._listening, self._receive, self._places_n = listening, receive, places_n
        self._callers: dict[Caller, asyncio.Task[None]] = {}

    async def __aenter__(self) -> Door:
        self._listening.setblocking(False)
        self._accepting = asyncio.create_task(self._accept())
        return self

    async def __aexit__(self, *_: object) -> None:
        tasks = [self._accepting, *self._callers.values()]
        for task in tasks:
            task.cancel()
        await asyncio.wait(tasks)
        self._listening.close()

    def knows(self, caller: Caller) -> None:
        """This caller showed that it may come in: it keeps its place, where one of those is left."""
        caller.known = caller.known or sum(other.known for other in self._callers) < self._places_n // 2

    async def _accept(self) -> None:
        while True:
            await _somebody(self._listening)
            try:  # at once: `sock_accept` loses whom it accepted where it is cancelled then
                connection, _ = self._listening.accept()
            except OSError:  # no handle is left, or the caller hung up before
                await asyncio.sleep(NO_HANDLE_S)
            else:
                connection.setblocking(False)
                await self._let_in(connection)

    async def _let_in(self, connection: socket.socket) -> None:
        scarce = connection.fileno() >= resource.getrlimit(resource.RLIMIT_NOFILE)[0] * (1 - RUNS_SHARE)
        strangers = [caller for caller in self._callers if not caller.known]
        if strangers and (scarce or len(strangers) >= self._places_n - self._places_n // 2):
            leaving = self._callers[strangers[0]]
            leaving.cancel()
            try:
                await asyncio.wait([leaving])
            except asyncio.CancelledError:
                connection.close()
                raise
        elif scarce:
            connection.close()
            return
        caller = Caller(connection)
        self._callers[caller] = task = asyncio.create_task(caller.serve(self._receive))
        task.add_done_callback(lambda _: self._left(caller))
        await asyncio.sleep(0)  # it begins before the next one is accepted

    def _left(self, caller: Caller) -> None:
        del self._callers[caller]
        caller.left()


async def _somebody(listening: socket.socket) -> None:
    """Wait until somebody wants to come in."""
    loop, came = asyncio.get_running_loop(), asyncio.Event()
    loop.add_reader(listening, came.set)
    try:
        await came.wait()
    finally:
        loop.remove_reader(listening)


async def handed_over(caller: Caller, protocol: asyncio.Protocol, over: asyncio.Event, tls: Any = None) -> None:
    """Serve a caller by a protocol of asyncio until its connection is over.

    Args:
        over: set by the protocol when the connection is lost.
        tls: context of `ssl`, None for a connection in clear.
    """
    limit_s = None if tls is None else GREETING_S
    transport, _ = await asyncio.get_running_loop().connect_accepted_socket(
        lambda: protocol, caller.connection, ssl=tls, ssl_handshake_timeout=limit_s
    )
    try:
        await over.wait()
    finally:
        transport.abort()
