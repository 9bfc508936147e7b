"""Who may ask the page's server: who says in time what is wanted, and names the server as people type it."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

import uvicorn
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol

from bracket_cell.viewing import door
from bracket_cell.viewing.door import Caller

POLICY = "default-src 'self'; frame-ancestors 'none'; form-action 'none'; base-uri 'none'"
HEADERS = {
    "Content-Security-Policy": POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
}


class Connection(H11Protocol):
    """A caller, who must say in time what it wants, and then again; `request.state.caller` is who it is."""

    _patience: asyncio.TimerHandle | None = None

    def __init__(self, server: uvicorn.Server, caller: Caller) -> None:
        super().__init__(server.config, server.server_state, {"caller": caller})
        self.over = asyncio.Event()

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self._wait()

    def data_received(self, data: bytes) -> None:
        super().data_received(data)
        if self.cycle is not None and not self.cycle.response_complete:
            self._stop_waiting()
        elif self._patience is None:
            self._wait()

    def connection_lost(self, exc: Exception | None) -> None:
        self._stop_waiting()
        super().connection_lost(exc)
        self.over.set()

    def _wait(self) -> None:
        self._patience = self.loop.call_later(door.GREETING_S, self.transport.close)

    def _stop_waiting(self) -> None:
        if self._patience is not None:
            self._patience.cancel()
            self._patience = None


class NamedAlone:
    """Lets in who asks for the server by its name: other names and other pages' requests are refused."""

    def __init__(self, app: ASGIApp, hosts: set[str], scheme: str) -> None:
        self._app, self._hosts, self._scheme = app, hosts, scheme

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            return
        headers = {name.decode("latin-1"): value.decode("latin-1") for name, value in scope["headers"]}
        origin = headers.get("origin")
        if headers.get("host") not in self._hosts:
            await PlainTextResponse("unknown host", 403)(scope, receive, send)
        elif origin is not None and origin not in {f"{self._scheme}://{host}" for host in self._hosts}:
            await PlainTextResponse("foreign origin", 403)(scope, receive, send)
        else:
            await self._app(scope, receive, _with_headers(send))


def _with_headers(send: Send) -> Callable[[Any], Awaitable[None]]:
    async def sending(message: Any) -> None:
        if message["type"] == "http.response.start":
            own = {name.lower() for name, _ in message.get("headers", ())}
            every = [(name.lower().encode(), value.encode()) for name, value in HEADERS.items()]
            extra = [(name, value) for name, value in every if name not in own]
            message = {**message, "headers": [*message.get("headers", ()), *extra]}
        await send(message)

    return sending
