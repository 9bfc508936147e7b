"""The page on which a person corrects labels, served on loopback to whoever has its address."""

from __future__ import annotations

import hmac
import json
import secrets
import socket
from pathlib import Path
from typing import Any

import uvicorn
from pydantic import ValidationError
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.middleware import Middleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from bracket_cell.learned.records import UNKNOWN
from bracket_ground.errors import InputError, mistakes
from bracket_lab.pictures.labels import LabelFolder, PictureLabels
from bracket_lab.pictures.suggestions import Suggester

STATIC = Path(__file__).parent / "static"
LOOPBACK = "127.0.0.1"
POLICY = "default-src 'self'; frame-ancestors 'none'; form-action 'none'; base-uri 'none'"
BODY_BYTES = 200_000


class LabelServer:
    """One server for one folder; `serve` returns after `close`.

    Raises:
        InputError: the port is taken.
    """

    def __init__(self, folder: LabelFolder, suggester: Suggester, port: int = 0) -> None:
        self._folder, self._suggester = folder, suggester
        self.token = secrets.token_urlsafe(24)
        self._socket = socket.socket()
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            self._socket.bind((LOOPBACK, port))
            self._socket.listen()  # a browser that comes before `serve` waits, and is not refused
        except OSError as error:
            raise InputError(
                f"port {port} cannot be used for the page: {error.strerror}; choose another --port"
            ) from None
        routes = [
            Route("/", self._page),
            Route("/folder", self._about),
            Route("/pictures/{number:int}", self._picture),
            Route("/pictures/{number:int}", self._save, methods=["PUT"]),
            Route("/images/{number:int}", self._image),
            Mount("/static", StaticFiles(directory=STATIC)),
        ]
        hosts = Middleware(TrustedHostMiddleware, allowed_hosts=[LOOPBACK, "localhost"])
        app = Starlette(routes=routes, middleware=[hosts])
        self._server = uvicorn.Server(uvicorn.Config(app, log_level="critical", lifespan="off", access_log=False))

    @property
    def address(self) -> str:
        """Where a person opens it; the token stands behind #, which browsers never send."""
        return f"http://{LOOPBACK}:{self._socket.getsockname()[1]}/#{self.token}"

    def serve(self) -> None:
        """Answer until it is closed, or interrupted."""
        self._server.run(sockets=[self._socket])
        self._socket.close()

    def close(self) -> None:
        """End soon; for another thread."""
        self._server.should_exit = True

    async def _page(self, _: Request) -> Response:
        return FileResponse(STATIC / "label.html", headers={"Content-Security-Policy": POLICY})

    async def _about(self, _: Request) -> Response:
        folder, product = self._folder, self._folder.product
        done = [row.file in folder.labels for row in folder.pictures]
        return JSONResponse({
            "camera": folder.camera,
            "files": [row.file for row in folder.pictures],
            "done": done,
            "types": [*product.parts, *([UNKNOWN] * (folder.camera == "wrist"))],
        })  # fmt: skip

    async def _picture(self, request: Request) -> Response:
        """The labels of a picture: a person's, or else what detectors say."""
        row = self._folder.pictures[self._number(request)]
        labels = self._folder.labels.get(row.file)
        if labels is None:
            labels = await run_in_threadpool(lambda: self._suggester.labels(row, self._folder.image(row)))
        data: dict[str, Any] = labels.model_dump(mode="json", exclude_unset=True)
        places = self._suggester.holes_px(row) if self._folder.camera == "overhead" else {}
        return JSONResponse({"labels": data, "holes_px": places, "by": self._suggester.by})

    async def _image(self, request: Request) -> Response:
        return FileResponse(self._folder.path / self._folder.pictures[self._number(request)].file)

    async def _save(self, request: Request) -> Response:
        if not hmac.compare_digest(request.headers.get("x-cell-token", "").encode(), self.token.encode()):
            return PlainTextResponse("to label, open the address that `cell label` printed", 401)
        if int(request.headers.get("content-length") or BODY_BYTES + 1) > BODY_BYTES:
            return PlainTextResponse("the labels are too long", 413)
        row = self._folder.pictures[self._number(request)]
        try:
            self._folder.save(row.file, PictureLabels.model_validate(json.loads(await request.body())))
        except (ValueError, ValidationError) as error:
            return PlainTextResponse("; ".join(mistakes(error)), 400)
        except InputError as error:
            return PlainTextResponse(str(error), 409)
        return Response(status_code=204)

    def _number(self, request: Request) -> int:
        number: int = request.path_params["number"]
        return min(number, len(self._folder.pictures) - 1)
