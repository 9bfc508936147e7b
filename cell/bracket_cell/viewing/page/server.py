"""Serves the operator's page: pictures and state go out, orders come in; who has no token is refused.

Starlette on uvicorn in a thread of its own. The loop hands over whole states and goes on: each client is sent the
newest one when it has taken the one before, and a client that takes none for a while is dropped.
"""

from __future__ import annotations

import asyncio
import hmac
import json
import math
import secrets
import threading
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Literal, cast

import cv2
import orjson
import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles
from starlette.types import Receive, Scope, Send

from bracket_cell.settings import PageSettings
from bracket_cell.viewing import door
from bracket_cell.viewing.door import Caller, Door, handed_over
from bracket_cell.viewing.gate import LOOPBACK, Address
from bracket_cell.viewing.page.callers import Connection, NamedAlone
from bracket_ground.errors import InputError
from bracket_ground.files.words.catalogue import catalogue, languages
from bracket_ground.interfaces.observation import Image
from bracket_ground.interfaces.operator import OperatorOrder, OrderKind

STATIC = Path(__file__).parent / "static"
BODY_BYTES = 4096
SLOW_S = 5.0  # a client that takes nothing for so long is dropped
CLIENTS_N = {None: 8, "look": 12, "operate": 16}  # pages that are open, of who has this token or less
KEPT_IMAGES = 4  # a client asks for the one that a state speaks of a moment later
JPEG_QUALITY = 75
STOP_S = 3.0
Role = Literal["operate", "look"]
NO_ROLE = "this needs a token: open an address that `cell run` printed"


class PageServer:
    """One server for one run.

    Args:
        where: beyond this machine, who only looks needs a token, too.
        obey: takes an order; raises InputError for one that makes no sense now.
        settings: TLS files and the language.
        scene: of the three-dimensional view.
        metrics: numbers of the run in Prometheus' text format.

    Attributes:
        where, scheme: as it was asked for, http or https.
        port: where it listens.
        tokens: by role; every order must carry the first. Only the addresses that the terminal prints have them.

    Raises:
        InputError: the port is taken, or a TLS file cannot be used.
    """

    def __init__(
        self,
        where: Address,
        obey: Callable[[OperatorOrder], None],
        settings: PageSettings = PageSettings(),  # noqa: B008 - frozen
        scene: Mapping[str, Any] | None = None,
        metrics: Callable[[], str] = str,
    ) -> None:
        self._obey, self.where, self._settings, self._metrics = obey, where, settings, metrics
        self._scene = orjson.dumps(scene or {})
        self.tokens: dict[Role, str] = {"operate": secrets.token_urlsafe(24), "look": secrets.token_urlsafe(24)}
        self._still = self._state = b"{}"
        self._number = 0
        self._images: deque[tuple[int, Image]] = deque(maxlen=KEPT_IMAGES)
        self._jpeg: tuple[int, bytes] = (-1, b"")
        self._news: dict[asyncio.Event, Role | None] = {}  # of each page that is open, and whose token it has
        self._closing = False
        self.scheme = "http" if settings.certificate is None else "https"
        self._socket = where.listening()
        self.port: int = self._socket.getsockname()[1]
        names = (LOOPBACK, "localhost") if where.local else (where.host,)
        self._hosts = {f"{name}:{self.port}" for name in names} | (set() if where.local else {where.host})
        routes = [
            Route("/", self._page),
            Route("/events", self._events),
            Route("/camera.jpg", self._camera),
            Route("/scene.json", self._told_scene),
            Route("/words/{language}.json", self._words),
            Route("/metrics", self._told_metrics),
            Route("/order", self._order, methods=["POST"]),
            Mount("/static", StaticFiles(directory=STATIC)),
        ]
        app = NamedAlone(Starlette(routes=routes), self._hosts, self.scheme)
        config = uvicorn.Config(
            app,
            log_level="critical",
            lifespan="off",
            access_log=False,
            timeout_graceful_shutdown=1,
            timeout_keep_alive=math.ceil(door.GREETING_S),  # the next request of a connection is a greeting, too
            ssl_certfile=settings.certificate,
            ssl_keyfile=settings.key,
        )
        try:
            config.load()
        except OSError as error:  # ssl.SSLError is one
            self._socket.close()
            raise InputError(f"page.certificate {settings.certificate}: cannot be used: {error}") from None
        self._server = uvicorn.Server(config)
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread = threading.Thread(target=self._serve, name="operator's page", daemon=True)
        self._thread.start()

    @property
    def address(self) -> str:
        """Where an operator opens it; the token stands behind #, which browsers never send."""
        return self.address_of("operate")

    def address_of(self, role: Role) -> str:
        """The same for who operates, or only looks."""
        return f"{self.scheme}://{self.where.host}:{self.port}/#{self.tokens[role]}"

    def _token(self, request: Request, given: str | None = None) -> Role | None:
        """Whose token somebody has, in a header but where another place is given; it keeps a place at the door."""
        given = request.headers.get("x-cell-token", "") if given is None else given
        for role, token in self.tokens.items():
            if hmac.compare_digest(given.encode(), token.encode()):
                self._door.knows(request.state.caller)
                return role
        return None

    def _may_look(self, request: Request) -> bool:
        return self._token(request) is not None or self.where.local

    @property
    def watched(self) -> bool:
        """Whether anybody looks."""
        return bool(self._news)

    def publish(self, state: dict[str, Any]) -> None:
        """A new state for every client; returns at once."""
        self._state, self._number = orjson.dumps(state, option=orjson.OPT_NON_STR_KEYS), self._number + 1
        loop = self._loop
        if loop is not None and not self._closing:
            try:
                loop.call_soon_threadsafe(self._tell)
            except RuntimeError:
                return  # the server has just ended

    def still(self, values: dict[str, Any]) -> None:
        """What a new client gets first."""
        self._still = orjson.dumps(values, option=orjson.OPT_NON_STR_KEYS)

    def show(self, sequence: int, image: Image) -> None:
        """The newest camera image; encoded when somebody asks for it."""
        if not self._images or self._images[-1][0] != sequence:
            self._images.append((sequence, image))

    def close(self) -> None:
        """Tell clients that it is over, and end; harmless when repeated."""
        if self._closing:
            return
        self._closing = True
        if self._loop is not None and self._loop.is_running():
            self._loop.call_soon_threadsafe(self._tell)
        self._server.should_exit = True
        self._thread.join(STOP_S)
        self._socket.close()

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

    def _tell(self) -> None:
        for news in self._news:
            news.set()

    async def _page(self, _: Request) -> Response:
        return Response((STATIC / "page.html").read_bytes(), media_type="text/html")

    async def _told_scene(self, request: Request) -> Response:
        if not self._may_look(request):
            return PlainTextResponse(NO_ROLE, 401)
        return Response(self._scene, media_type="application/json")

    async def _words(self, request: Request) -> Response:
        """A catalogue; "usual" is that of the configuration."""
        name = request.path_params["language"]
        name = self._settings.language if name == "usual" else name
        if name not in languages():
            return PlainTextResponse(f"no language {name!r}; there are: {', '.join(languages())}", 404)
        told = {"language": name, "languages": languages(), "texts": dict(catalogue(name).texts)}
        return Response(orjson.dumps(told), media_type="application/json")

    async def _told_metrics(self, request: Request) -> Response:
        if not self._may_look(request):
            return PlainTextResponse(NO_ROLE, 401)
        return Response(self._metrics(), media_type="text/plain; version=0.0.4")

    async def _camera(self, request: Request) -> Response:
        """The image with the number that is asked for, or the newest."""
        if not self._may_look(request):
            return PlainTextResponse(NO_ROLE, 401)
        images, wanted = list(self._images), request.query_params.get("sequence", "")
        if not images:
            return Response(status_code=204)
        image = next((one for one in images if str(one[0]) == wanted), images[-1])
        if self._jpeg[0] != image[0]:
            self._jpeg = image[0], await asyncio.to_thread(_encoded, image[1])
        return Response(self._jpeg[1], media_type="image/jpeg", headers={"Cache-Control": "no-store"})

    async def _events(self, request: Request) -> Response:
        token = self._token(request, request.query_params.get("token"))  # EventSource sends no headers
        if token is None and not self.where.local:
            return PlainTextResponse(NO_ROLE, 401)
        ranks = list(CLIENTS_N)
        open_n = sum(ranks.index(other) <= ranks.index(token) for other in self._news.values())
        if open_n >= CLIENTS_N[token]:
            return PlainTextResponse("too many pages are open already", 503)
        return _Events(self, token)

    async def _order(self, request: Request) -> Response:
        if self._token(request) != "operate":
            problem = "this page is view-only; to give orders, open the address that `cell run` printed"
            return PlainTextResponse(problem, 401)
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
            order = _order_of(json.loads(body))
        except (ValueError, TypeError, RecursionError) as error:
            return PlainTextResponse(f"this is not an order: {error}", 400)
        try:
            self._obey(order)
        except InputError as error:
            return PlainTextResponse(str(error), 409)
        return Response(status_code=204)


class _Events(Response):
    """Server-sent events for one client: what stands still, then the newest state each time that it took the last."""

    def __init__(self, server: PageServer, token: Role | None) -> None:
        super().__init__()
        self._server, self._whose = server, token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:  # noqa: ARG002
        server, news = self._server, asyncio.Event()
        news.set()
        headers = [(b"content-type", b"text/event-stream"), (b"cache-control", b"no-store")]
        gone = asyncio.ensure_future(_gone(receive))
        gone.add_done_callback(lambda _: news.set())
        server._news[news] = self._whose
        try:
            await send({"type": "http.response.start", "status": 200, "headers": headers})
            await self._tell(send, b"role", (self._whose or "look").encode())
            await self._tell(send, b"still", server._still)
            told = -1
            while not gone.done() and not (server._closing and told == server._number):
                if told != server._number:
                    told = server._number
                    await self._tell(send, b"state", server._state)
                news.clear()
                if told == server._number and not server._closing and not gone.done():
                    await news.wait()
            await send({"type": "http.response.body", "body": b"", "more_body": False})
        except TimeoutError:
            return  # too slow: the connection ends, and the page connects anew
        finally:
            gone.cancel()
            del server._news[news]

    async def _tell(self, send: Send, name: bytes, data: bytes) -> None:
        body = b"event: " + name + b"\ndata: " + data + b"\n\n"
        await asyncio.wait_for(_sent(send, body), SLOW_S)


async def _gone(receive: Receive) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass


async def _sent(send: Send, body: bytes) -> None:
    await send({"type": "http.response.body", "body": body, "more_body": True})


def _encoded(image: Image) -> bytes:
    return cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1].tobytes()


def _order_of(read: object) -> OperatorOrder:
    """An order from JSON; ValueError says what is wrong with it."""
    if not isinstance(read, dict) or not set(read) <= {"kind", "value", "question"}:
        raise ValueError("it has kind, value and question, and nothing else")
    kind, value, question = read.get("kind"), read.get("value", ""), read.get("question")
    if not isinstance(kind, str) or not isinstance(value, str):
        raise ValueError("kind and value are text")
    if question is not None and (not isinstance(question, int) or isinstance(question, bool)):
        raise ValueError("a question is a number")
    return OperatorOrder(cast(OrderKind, kind), value, question)  # the channel refuses other kinds
