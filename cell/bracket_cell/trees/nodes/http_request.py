"""Asking a web server."""

from __future__ import annotations

import json
import socket
from enum import Enum
from typing import Any
from urllib.parse import SplitResult, quote, urlsplit

from bracket_ground.errors import mistakes, words_of
from btxml.engine.errors import NodeError
from btxml.engine.literals import JSON
from btxml.engine.node import SUCCESS
from btxml.engine.outside import LENGTH_LIMIT, Outside, when_cancelled
from btxml.engine.ports import InputPort, OutputPort
from btxml.engine.status import Status

SCHEMES = ("http", "https")
STAY = "%/?:@!$&'()*+,;=~"  # in a path and a query; what else is no letter or digit of ASCII is quoted (RFC 3986, 2)


class Method(Enum):
    """What a web server is asked to do (RFC 9110, 9.3)."""

    GET = "GET"
    POST = "POST"
    PUT = "PUT"
    PATCH = "PATCH"
    DELETE = "DELETE"


class HttpRequest(Outside):
    """Ask a web server; succeeds where it answers with a status from 200 to 299. A replay asks nobody."""

    url = InputPort(str, "like http://host:8000/path; it stands in the log, so no passwords")
    method = InputPort(Method, "what is asked for", default=Method.GET)
    body = InputPort(str, 'what is sent, like json:{"part": "o1"}', default="")
    content_type = InputPort(str, "what the body is", default="application/json")
    status_code = OutputPort(int, "the server's status, like 200")
    result = OutputPort(str, "what the server answered")

    def question(self) -> Any:
        url = self.url.get()
        _address(url)
        asked = {"method": self.method.get().value, "url": url, "limit_s": self.limit_s.get()}
        return {**asked, "body": _body(self.body.get()), "content_type": self.content_type.get()}

    def ask(self, question: Any) -> Any:
        from http.client import HTTPConnection, HTTPException, HTTPSConnection  # slow, and most trees ask nobody

        url = _address(question["url"])
        kind = HTTPSConnection if url.scheme == "https" else HTTPConnection
        connection = kind(url.netloc, timeout=question["limit_s"])
        try:
            connection.connect()
            when_cancelled(lambda: connection.sock.shutdown(socket.SHUT_RDWR))
            path = quote(f"{url.path or '/'}{'?' if url.query else ''}{url.query}", STAY)
            head = {"Content-Type": question["content_type"]} if question["body"] else {}
            connection.request(question["method"], path, question["body"].encode() or None, head)
            answer = connection.getresponse()
            text = answer.read(LENGTH_LIMIT).decode(errors="replace")
        except HTTPException:
            raise NodeError(f"{question['url']} gave no answer of HTTP") from None
        except OSError as error:
            raise NodeError(f"{question['url']}: {words_of(error)}") from None
        except UnicodeError:
            raise NodeError(f"{question['url']} names no host that there can be") from None
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


def _address(text: str) -> SplitResult:
    """An address in its pieces; raises NodeError for one of nothing that could be asked."""
    try:
        url = urlsplit(text)
        if url.scheme in SCHEMES and url.hostname and " " not in url.netloc and url.port != 0:
            return url
    except ValueError:  # of an odd port, or brackets that do not close
        pass
    raise NodeError(f"'{text}' is no address; legal: http:// or https://, a host, :port, /path")


def _body(text: str) -> str:
    """What a port's text means: what stands behind `json:` is sent where it is JSON."""
    body = text.removeprefix(JSON)
    try:
        return body if body == text else json.dumps(json.loads(body))
    except ValueError as error:
        raise NodeError(f"port body: '{body}' {mistakes(error)[0]}") from None
