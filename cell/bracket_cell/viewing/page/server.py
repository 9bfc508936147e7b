"""Serves the operator's page of a run: pictures and state go out, orders come in; who has no token is refused.

Starlette on uvicorn in a thread of its own. The loop hands over whole states and goes on: each client is sent the
newest one when it has taken the one before, of that what changed, and a client that takes none for a while is dropped.
"""

from __future__ import annotations

import asyncio
import secrets
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any, cast

import cv2
import orjson
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route
from starlette.types import Receive, Scope, Send

from bracket_cell.production.samples import Sample, metrics_of
from bracket_cell.settings import PageSettings
from bracket_cell.viewing.gate import Address
from bracket_cell.viewing.page.web import NO_ROLE, Role, WebServer, posted, same
from bracket_ground.errors import InputError
from bracket_ground.interfaces.observation import Image
from bracket_ground.interfaces.operator import OperatorOrder, OrderKind

SLOW_S = 5.0  # a client that takes nothing for so long is dropped
CLIENTS_N = {None: 8, "look": 12, "operate": 16}  # pages that are open, of who has this token or less
KEPT_IMAGES = 4  # a client asks for the one that a state speaks of a moment later
JPEG_QUALITY = 75


class PageServer(WebServer):
    """One server for one run.

    Args:
        where: beyond this machine, who only looks needs a token, too.
        obey: takes an order; raises InputError for one that makes no sense now.
        settings: TLS files and the language.
        scene: of the three-dimensional view.
        samples: numbers of the run.
        still: what a new client gets first.
        tree: what of the tree a page has not, which has ticks of a run up to a number, and so many trees.

    Attributes:
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
        samples: Callable[[], Sequence[Sample]] = tuple,
        still: Mapping[str, Any] | None = None,
        tree: Callable[[str, int, int], bytes] = lambda *_: b"{}",
    ) -> None:
        self._obey, self._scene, self._samples, self._tree = obey, orjson.dumps(dict(scene or {})), samples, tree
        self.tokens: dict[Role, str] = {"operate": secrets.token_urlsafe(24), "look": secrets.token_urlsafe(24)}
        self._still, self._state = b"{}", dict[str, bytes]()
        self.still(dict(still or {}))
        self._number, self._published_s = 0, time.monotonic()
        self._images: deque[tuple[int, Image]] = deque(maxlen=KEPT_IMAGES)
        self._jpeg: tuple[int, bytes] = (-1, b"")
        self._news: dict[asyncio.Event, Role | None] = {}  # of each page that is open, and whose token it has
        routes = [
            Route("/events", self._events),
            Route("/camera.jpg", self._camera),
            Route("/scene.json", self._told_scene),
            Route("/metrics", self._told_metrics),
            Route("/samples", self._told_samples),
            Route("/tree.json", self._told_tree),
            Route("/order", self._order, methods=["POST"]),
        ]
        super().__init__(where, settings, routes)

    @property
    def address(self) -> str:
        """Where an operator opens it; the token stands behind #, which browsers never send."""
        return self.address_of("operate")

    def address_of(self, role: Role) -> str:
        """The same for who operates, or only looks."""
        return f"{self.scheme}://{self.where.host}:{self.port}/#{self.tokens[role]}"

    def _role_of(self, token: str) -> Role | None:
        return next((role for role, known in self.tokens.items() if same(token, known)), None)

    @property
    def watched(self) -> bool:
        """Whether anybody looks."""
        return bool(self._news)

    def publish(self, state: dict[str, Any]) -> None:
        """A new state for every client; returns at once."""
        encoded = {name: orjson.dumps(value, option=orjson.OPT_NON_STR_KEYS) for name, value in state.items()}
        self._state, self._number = encoded, self._number + 1
        self._published_s = time.monotonic()
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

    def _over(self) -> None:
        self._tell()

    def _tell(self) -> None:
        for news in self._news:
            news.set()

    async def _told_scene(self, request: Request) -> Response:
        if not self._may_look(request):
            return PlainTextResponse(NO_ROLE, 401)
        return Response(self._scene, media_type="application/json")

    async def _told_metrics(self, request: Request) -> Response:
        if not self._may_look(request):
            return PlainTextResponse(NO_ROLE, 401)
        return Response(metrics_of(self._samples()), media_type="text/plain; version=0.0.4")

    async def _told_samples(self, request: Request) -> Response:
        if not self._may_look(request):
            return PlainTextResponse(NO_ROLE, 401)
        return Response(orjson.dumps(self._samples()), media_type="application/json")

    async def _told_tree(self, request: Request) -> Response:
        if not self._may_look(request):
            return PlainTextResponse(NO_ROLE, 401)
        asked = request.query_params
        try:
            number, parts = int(asked.get("number", "0")), int(asked.get("parts", "0"))
        except ValueError:
            return PlainTextResponse("number and parts are numbers", 400)
        return Response(self._tree(asked.get("run", ""), number, max(0, parts)), media_type="application/json")

    async def _camera(self, request: Request) -> Response:
        """The image with the number that is asked for, or the newest."""
        if not self._may_look(request):
            return PlainTextResponse(NO_ROLE, 401)
        images, wanted = list(self._images), request.query_params.get("sequence", "")
        if not images:
            return Response(status_code=204)
        image = next((shown for shown in images if str(shown[0]) == wanted), images[-1])
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
        read = await posted(request)
        if isinstance(read, Response):
            return read
        try:
            self._obey(_order_of(read))
        except ValueError as error:
            return PlainTextResponse(f"this is not an order: {error}", 400)
        except InputError as error:
            return PlainTextResponse(str(error), 409)
        return Response(status_code=204)


class _Events(Response):
    """Server-sent events for one client: what stands still, then, each time that it took the last, what changed since.

    Before each comes how old it is [s], and when it was sent [s], so that a client that slept knows old news.
    """

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
            sent, known = -1, dict[str, bytes]()
            while not gone.done() and not (server._closing and sent == server._number):
                if sent != server._number:
                    sent, age_s = server._number, time.monotonic() - server._published_s
                    await self._tell(send, b"age", f"{age_s:.2f} {time.monotonic():.2f}".encode())
                    state = server._state
                    changed = [name for name, value in state.items() if known.get(name) != value]
                    await self._tell(send, b"state", _object({name: state[name] for name in changed}))
                    known = state
                news.clear()
                if sent == server._number and not server._closing and not gone.done():
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


def _object(members: Mapping[str, bytes]) -> bytes:
    return b"{" + b",".join(orjson.dumps(name) + b":" + value for name, value in members.items()) + b"}"


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
