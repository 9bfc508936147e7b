"""Asking a web server."""

from __future__ import annotations

import json
import socket
from typing import Any
from urllib.parse import urlsplit

from bracket_ground.errors import mistakes
from btxml.engine.errors import NodeError
from btxml.engine.literals import JSON
from btxml.engine.node import SUCCESS
from btxml.engine.outside import LENGTH_LIMIT, Outside, when_cancelled
from btxml.engine.ports import InputPort, OutputPort
from btxml.engine.status import Status

SCHEMES = ("http", "https")


class HttpRequest(Outside):
    """Ask a web server; succeeds where it answers with a status from 200 to 299. A replay asks nobody."""

    url = InputPort(str, "like http://host:8000/path; it stands in the log, so no passwords")
    method = InputPort(str, "GET, POST, PUT, PATCH or DELETE", default="GET")
    body = InputPort(str, 'what is sent, like json:{"part": "o1"}', default="")
    content_type = InputPort(str, "what the body is", default="application/json")
    status_code = OutputPort(int, "the server's status, like 200")
    result = OutputPort(str, "what the server answered")

    def question(self) -> Any:
        url = self.url.get()
        if (scheme := urlsplit(url).scheme) not in SCHEMES:
            raise NodeError(f"'{url}' begins with '{scheme}'; legal: http:// and https://")
        asked = {"method": self.method.get(), "url": url, "limit_s": self.limit_s.get()}
        return {**asked, "body": _body(self.body.get()), "content_type": self.content_type.get()}

    def ask(self, question: Any) -> Any:
        from http.client import HTTPConnection, HTTPException, HTTPSConnection  # slow, and most trees ask nobody

        url = urlsplit(question["url"])
        kind = HTTPSConnection if url.scheme == "https" else HTTPConnection
        connection = kind(url.netloc, timeout=question["limit_s"])
        try:
            connection.connect()
            when_cancelled(lambda: connection.sock.shutdown(socket.SHUT_RDWR))
            path = f"{url.path or '/'}{'?' if url.query else ''}{url.query}"
            head = {"Content-Type": question["content_type"]} if question["body"] else {}
            connection.request(question["method"], path, question["body"].encode() or None, head)
            answer = connection.getresponse()
            text = answer.read(LENGTH_LIMIT).decode(errors="replace")
        except HTTPException as error:
            raise NodeError(f"{question['url']} gave no answer of HTTP: {error!r}") from None
        finally:
            connection.close()
        return {"status": answer.status, "text": text}

    def take(self, answer: Any) -> Status:
        self.status_code.set(answer["status"])
        self.result.set(answer["text"])
        if not 200 <= answer["status"] < 300:
            self.error.set(f"the server answered with status {answer['status']}")
            raise NodeError(f"{self.url.get()}: the server answered with status {answer['status']}")
        return SUCCESS


def _body(text: str) -> str:
    """What a port's text means: what stands behind `json:` is sent where it is JSON."""
    body = text.removeprefix(JSON)
    try:
        return body if body == text else json.dumps(json.loads(body))
    except ValueError as error:
        raise NodeError(f"port body: '{body}' {mistakes(error)[0]}") from None
