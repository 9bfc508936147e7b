"""Serves the page of a cell: of the run that goes on, and between runs what happened and how to begin."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import AsyncIterator, Mapping
from contextlib import suppress
from typing import Any

import orjson
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response, StreamingResponse
from starlette.routing import Route

from bracket_cell.log.report.report import production_html
from bracket_cell.production.book import csv_lines
from bracket_cell.production.samples import metrics_of
from bracket_cell.serving.control import CellControl
from bracket_cell.serving.paired import Paired
from bracket_cell.serving.relay import asked
from bracket_cell.settings import PageSettings
from bracket_cell.viewing.advice import ended_advice
from bracket_cell.viewing.gate import Address
from bracket_cell.viewing.page.state import BRACKETS_N, bracket_data
from bracket_cell.viewing.page.web import NO_ROLE, Role, WebServer, posted
from bracket_ground.errors import InputError

MOST_NUMBER = 2**63 - 1  # of a bracket or run that the book can be asked for
BEAT_S = 1.0  # between two states while no run goes on
NO_ANSWER = "the run does not answer; use the stop button at the cell"


class CellServer(WebServer):
    """One server for one cell; runs begin and end below it.

    Args:
        control: the cell.
        name: of the product.

    Raises:
        InputError: the port is taken, or a TLS file cannot be used.
    """

    def __init__(self, where: Address, settings: PageSettings, control: CellControl, paired: Paired, name: str) -> None:
        self._control, self._paired, self._name = control, paired, name
        self._launcher, self._book = control.launcher, control.book
        routes = [
            Route("/events", self._events),
            *(Route(path, self._of_the_run) for path in ("/camera.jpg", "/scene.json", "/tree.json")),
            Route("/metrics", self._metrics),
            Route("/production", self._production),
            Route("/production.csv", self._csv),
            *(
                Route(path, does, methods=["POST"])
                for path, does in (("/order", self._order), ("/begin", self._begin), ("/pair", self._pair))
            ),
        ]
        super().__init__(where, settings, routes)

    @property
    def address(self) -> str:
        """Where people open it."""
        return f"{self.scheme}://{self.where.host}:{self.port}/"

    def _role_of(self, token: str) -> Role | None:
        try:
            return self._paired.role_of(token)
        except InputError:
            return None

    def between(self) -> dict[str, Any]:
        """What a page shows while no run can be seen."""
        runs, busy, problem = self._book.runs(1), self._launcher.busy, self._launcher.problem
        last = runs[-1] if runs else None
        if problem:
            words = "It did not begin"
        elif busy:
            words = "Wait: the cell begins" if last is None or not last.ended else "Wait: the run is put away"
        elif last is None:
            words = "Nothing was made here yet"
        else:
            words = ended_advice(last.ended, last.signal)
        resumable = last is not None and last.ended in ("", "interrupted", "fault", "timeout") and not busy
        trouble = bool(problem) or (last is not None and last.ended in ("", "fault") and not busy)
        return {
            "product": self._name,
            "words": words,
            "moment": "alarm" if trouble else "beginning" if busy else "over",
            "problem": problem,
            "reason": "" if last is None else last.reason,
            "may_begin": self._control.may_begin is not None and not busy,
            "resumable": resumable,
            "variants": dict(self._control.titles),
            "brackets": [bracket_data(row) for row in self._book.brackets(last=BRACKETS_N)],
            "orders": self._control.orders(),
        }

    async def _events(self, request: Request) -> Response:
        role = self._token(request, request.query_params.get("token", ""))  # EventSource sends no headers
        if role is None and not self.where.local:
            return PlainTextResponse(NO_ROLE, 401)
        return StreamingResponse(
            self._told(role), media_type="text/event-stream", headers={"Cache-Control": "no-store"}
        )

    async def _told(self, role: Role | None) -> AsyncIterator[bytes]:
        """Events of the run that goes on, and between runs the state of the cell, again and again."""
        yield _event("served", "yes")
        yield _event("role", role or "look")
        if role == "operate":
            yield _event("codes", json.dumps(self._paired.codes))
        while not self._closing:
            with suppress(OSError, TimeoutError):  # no run goes on, or it is stopped
                async with asked(self._launcher.socket, "/events", role) as answer:
                    async for event in answer.events():
                        yield event
            news = await asyncio.to_thread(self.between)
            yield _event("age", f"0 {time.monotonic():.2f}")
            yield _event("between", json.dumps(news))
            await asyncio.sleep(BEAT_S)

    async def _of_the_run(self, request: Request) -> Response:
        """What only a run knows, as its camera's image."""
        if not self._may_look(request):
            return PlainTextResponse(NO_ROLE, 401)
        query = f"?{request.url.query}" if request.url.query.isascii() and request.url.query.isprintable() else ""
        try:
            async with asked(self._launcher.socket, f"{request.url.path}{query}", self._token(request)) as answer:
                return Response(await answer.body(), answer.status, media_type=answer.headers.get("content-type"))
        except TimeoutError:
            return PlainTextResponse(NO_ANSWER, 504)
        except OSError:
            return Response(status_code=204)

    async def _metrics(self, request: Request) -> Response:
        if not self._may_look(request):
            return PlainTextResponse(NO_ROLE, 401)
        try:
            text = metrics_of(await self._control.samples())
        except TimeoutError:
            return PlainTextResponse(NO_ANSWER, 504)
        return Response(text, media_type="text/plain; version=0.0.4")

    async def _production(self, request: Request) -> Response:
        """The page of the book; a link has its token in the address, and loads nothing from elsewhere."""
        if self._token(request, request.query_params.get("token", "")) is None and not self.where.local:
            return PlainTextResponse(NO_ROLE, 401)
        page = await asyncio.to_thread(production_html, self._book)
        policy = {"Content-Security-Policy": "default-src 'none'; style-src 'unsafe-inline'; frame-ancestors 'none'"}
        return Response(page, media_type="text/html", headers=policy)

    async def _csv(self, request: Request) -> Response:
        if self._token(request, request.query_params.get("token", "")) is None and not self.where.local:
            return PlainTextResponse(NO_ROLE, 401)
        rows = await asyncio.to_thread(self._book.brackets)
        name = {"Content-Disposition": "attachment; filename=production.csv"}
        return Response("".join(csv_lines(rows)), media_type="text/csv; charset=utf-8", headers=name)

    async def _order(self, request: Request) -> Response:
        """Orders go to the run; a work order or an inspection is taken between runs, too."""
        read = await self._read(request)
        if isinstance(read, Response):
            return read
        if read.get("kind") == "inspected":
            return self._inspected(read.get("run"), read.get("number"), read.get("right"))
        try:
            await self._control.order(read)
        except TimeoutError:
            return PlainTextResponse(NO_ANSWER, 504)
        except InputError as error:
            return PlainTextResponse(str(error), 409)
        return Response(status_code=204)

    def _inspected(self, run: object, number: object, right: object) -> Response:
        """What somebody found who looked at a finished bracket."""
        if type(run) is not int or type(number) is not int or type(right) is not bool:
            return PlainTextResponse("an inspection has run and number, and right: true or false", 400)
        found = max(run, number) <= MOST_NUMBER and self._book.inspected(run, number, right)
        return Response(status_code=204) if found else PlainTextResponse("there is no such finished bracket", 409)

    async def _begin(self, request: Request) -> Response:
        read = await self._read(request)
        if isinstance(read, Response):
            return read
        browser = self._paired.browser(request.headers.get("x-cell-token", ""))
        try:
            self._control.begin("" if browser is None else browser.name, resume=read.get("resume") is True)
        except InputError as error:
            return PlainTextResponse(str(error), 409)
        return Response(status_code=204)

    async def _pair(self, request: Request) -> Response:
        read = await posted(request)
        if isinstance(read, Response):
            return read
        try:
            token, role = self._paired.pair(str(read["code"]), str(read["name"]))
        except (TypeError, KeyError, IndexError):
            return PlainTextResponse("code and name are wanted", 400)
        except InputError as error:
            return PlainTextResponse(str(error), 403)
        return Response(orjson.dumps({"token": token, "role": role}), media_type="application/json")

    async def _read(self, request: Request) -> Mapping[str, Any] | Response:
        """The JSON that somebody posts who may operate, or what refuses it."""
        if self._token(request) != "operate":
            return PlainTextResponse("this page is view-only; pair it with the code that `cell serve` shows", 401)
        read = await posted(request)
        known = isinstance(read, dict | Response)
        return read if known else PlainTextResponse("this is not an order: it is no object", 400)


def _event(name: str, data: str) -> bytes:
    return f"event: {name}\ndata: {data}\n\n".encode()
