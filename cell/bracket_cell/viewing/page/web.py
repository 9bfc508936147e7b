"""What the pages' servers share: callers at the door, TLS, tokens, static files and words, in a thread of its own."""

from __future__ import annotations

import asyncio
import hmac
import math
import threading
from collections.abc import Sequence
from pathlib import Path
from ssl import SSLError
from typing import Any, Literal, cast

import orjson
import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import BaseRoute, Mount, Route
from starlette.staticfiles import StaticFiles

from bracket_cell.settings import PageSettings
from bracket_cell.viewing import door
from bracket_cell.viewing.door import Caller, Door, handed_over
from bracket_cell.viewing.gate import LOOPBACK, Address
from bracket_cell.viewing.page.callers import POLICY, Connection, NamedAlone
from bracket_ground.errors import InputError, mistakes, words_of
from bracket_ground.files.words.catalogue import catalogue, languages

STATIC = Path(__file__).parent / "static"
BODY_BYTES = 4096
STOP_S = 3.0
RUN = "run"  # the name by which a server asks for a run's page at its socket
ROLE = "x-cell-role"  # in which it says who asks
Role = Literal["operate", "look"]
NO_ROLE = "this needs a token: open an address that `cell run` printed, or type the code of `cell serve`"


class WebServer:
    """Serves one page.

    Args:
        where: beyond this machine, who only looks needs a token, too.
        settings: TLS files and the language.
        routes: beside the page itself.

    Attributes:
        where, scheme: as it was asked for, http or https.
        port: where it listens; 0 for a socket of this machine.

    Raises:
        InputError: the port is taken, or a TLS file cannot be used.
    """

    def __init__(self, where: Address, settings: PageSettings, routes: Sequence[BaseRoute]) -> None:
        self.where, self._settings, self._closing = where, settings, False
        self.scheme = "http" if settings.certificate is None or where.path is not None else "https"
        self._socket = where.listening()
        self.port: int = 0 if where.path is not None else self._socket.getsockname()[1]
        names = (LOOPBACK, "localhost") if where.local else (where.host,)
        self._hosts = {f"{name}:{self.port}" for name in names} | (set() if where.local else {where.host})
        self._hosts = {RUN} if where.path is not None else self._hosts
        shared = [
            Route("/", self._page),
            Route("/tree", self._tree_page),
            Route("/words/{language}.json", self._words),
            Mount("/static", StaticFiles(directory=STATIC)),
        ]
        app = NamedAlone(Starlette(routes=[*shared, *routes]), self._hosts, self.scheme)
        config = uvicorn.Config(
            app,
            log_level="critical",
            lifespan="off",
            ws="none",
            access_log=False,
            timeout_graceful_shutdown=1,
            timeout_keep_alive=math.ceil(door.GREETING_S),  # the next request of a connection is a greeting, too
            ssl_certfile=settings.certificate if self.scheme == "https" else None,
            ssl_keyfile=settings.key if self.scheme == "https" else None,
        )
        try:
            config.load()
        except OSError as error:
            self._socket.close()
            why = "no certificate with its key, in PEM" if isinstance(error, SSLError) else words_of(error)
            raise InputError(f"page.certificate {settings.certificate}, page.key {settings.key}: {why}") from None
        self._server = uvicorn.Server(config)
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread = threading.Thread(target=self._serve, name="operator's page", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End; harmless when repeated."""
        if self._closing:
            return
        self._closing = True
        if self._loop is not None and self._loop.is_running():
            self._loop.call_soon_threadsafe(self._over)
        self._server.should_exit = True
        self._thread.join(STOP_S)
        self._socket.close()
        if self.where.path is not None:
            self.where.path.unlink(missing_ok=True)

    def _over(self) -> None:
        """Tell clients that it ends; called in the server's loop."""

    def _role_of(self, token: str) -> Role | None:
        """Whose token this is; a derived class knows."""
        raise NotImplementedError

    def _token(self, request: Request, given: str | None = None) -> Role | None:
        """Whose token somebody has, in a header but where another place is given; it keeps a place at the door."""
        if self.where.path is not None:  # only the server of this user reaches it, and knows who asks
            word = request.headers.get(ROLE, "")
            return cast("Role", word) if word in ("operate", "look") else None
        role = self._role_of(request.headers.get("x-cell-token", "") if given is None else given)
        if role is not None:
            self._door.knows(request.state.caller)
        return role

    def _may_look(self, request: Request) -> bool:
        return self._token(request) is not None or self.where.local

    def _serve(self) -> None:
        with asyncio.Runner() as runner:
            self._loop = runner.get_loop()
            runner.run(self._open())

    async def _open(self) -> None:
        async with Door(self._socket, self._receive) as self._door:
            await self._server.serve(sockets=[])

    async def _receive(self, caller: Caller) -> None:
        connection = Connection(self._server, caller)
        await handed_over(caller, connection, connection.over, self._server.config.ssl)

    async def _page(self, _: Request) -> Response:
        return Response((STATIC / "page.html").read_bytes(), media_type="text/html")

    async def _tree_page(self, _: Request) -> Response:
        """The page of the running tree, which stands in the other."""
        policy = {"Content-Security-Policy": POLICY.replace("frame-ancestors 'none'", "frame-ancestors 'self'")}
        return Response((STATIC / "tree.html").read_bytes(), media_type="text/html", headers=policy)

    async def _words(self, request: Request) -> Response:
        """A catalogue; "usual" is that of the configuration."""
        name = request.path_params["language"]
        name = self._settings.language if name == "usual" else name
        if name not in languages():
            return PlainTextResponse(f"no language {name!r}; there are: {', '.join(languages())}", 404)
        fields = {"language": name, "languages": languages(), "texts": dict(catalogue(name).texts)}
        return Response(orjson.dumps(fields), media_type="application/json")


async def posted(request: Request) -> Any:
    """What the JSON says that was posted, or the Response that refuses it."""
    if request.headers.get("content-type", "").partition(";")[0] != "application/json":
        return PlainTextResponse("an order must be JSON", 415)
    body = b""
    try:
        async with asyncio.timeout(door.GREETING_S):
            async for piece in request.stream():
                body += piece
                if len(body) > BODY_BYTES:
                    return PlainTextResponse("the order is too long", 413)
    except TimeoutError:
        return PlainTextResponse("the order did not come to its end", 408)
    try:
        return orjson.loads(body)
    except ValueError as error:
        return PlainTextResponse(f"this is not an order: it {mistakes(error)[0]}", 400)


def same(one: str, other: str) -> bool:
    """Whether two secrets are the same, in constant time."""
    return hmac.compare_digest(one.encode(), other.encode())
