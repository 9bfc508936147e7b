"""Asks the page of a run at its socket, as HTTP/1.0: one question, one answer, of which the end is the hang-up."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

from bracket_cell.viewing.page.web import ROLE, RUN, Role

ANSWERS_S = 3.0  # a run that says nothing for so long is told as one that does not answer
LONGEST = 8_000_000  # an image of a camera
HEAD_ENDS, EVENT_ENDS = b"\r\n\r\n", b"\n\n"


@dataclass(frozen=True)
class Answer:
    """What a run's page answered; the body follows in the stream."""

    status: int
    headers: Mapping[str, str]
    stream: asyncio.StreamReader

    async def body(self) -> bytes:
        """All of it.

        Raises:
            TimeoutError: it does not come.
        """
        async with asyncio.timeout(ANSWERS_S):
            return await self.stream.read(LONGEST)

    async def events(self) -> AsyncIterator[bytes]:
        """Server-sent events, whole ones alone; ends where the run hangs up, or is gone."""
        try:
            while True:
                yield await self.stream.readuntil(EVENT_ENDS)
        except (asyncio.IncompleteReadError, OSError):
            return


@asynccontextmanager
async def asked(path: Path, target: str, role: Role | None, body: bytes | None = None) -> AsyncIterator[Answer]:
    """Ask a run, or tell it something.

    Args:
        path: of its socket.
        target: path and query of the address.
        role: of who asks.
        body: JSON that is posted.

    Raises:
        OSError: nobody listens there.
        TimeoutError: it does not answer.
    """
    reader, writer = await asyncio.open_unix_connection(path, limit=LONGEST)
    try:
        async with asyncio.timeout(ANSWERS_S):
            writer.write(_question(target, role, body))
            await writer.drain()
            head = (await reader.readuntil(HEAD_ENDS)).decode("latin-1").split("\r\n")
        fields = dict(line.lower().split(": ", 1) for line in head[1:] if ": " in line)
        yield Answer(int(head[0].split()[1]), fields, reader)
    except asyncio.IncompleteReadError as error:
        raise ConnectionResetError("the run hung up") from error
    finally:
        writer.transport.abort()


def _question(target: str, role: Role | None, body: bytes | None) -> bytes:
    lines = [f"{'GET' if body is None else 'POST'} {target} HTTP/1.0", f"Host: {RUN}", f"{ROLE}: {role or ''}"]
    if body is not None:
        lines += ["Content-Type: application/json", f"Content-Length: {len(body)}"]
    return "\r\n".join([*lines, "", ""]).encode("latin-1") + (body or b"")
