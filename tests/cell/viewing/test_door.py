"""The door before every server of a run: so many at once, newcomers come in, and the run keeps its handles."""

from __future__ import annotations

import asyncio
import gc
import resource
import socket
import warnings
from collections.abc import Awaitable, Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from bracket_cell.viewing.door import Caller, Door

PLACES_N = 8
WELCOME = b"come in"


@pytest.fixture
def crowd() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


async def receive(caller: Caller) -> None:
    """Tells a caller that it is in, and waits until it is hung up on."""
    try:
        caller.connection.sendall(WELCOME)
        await asyncio.Event().wait()
    finally:
        caller.connection.close()


def behind_a_door(test: Callable[[Door, int], Awaitable[None]]) -> None:
    async def run() -> None:
        listening = socket.create_server(("127.0.0.1", 0))
        port = listening.getsockname()[1]
        async with Door(listening, receive, PLACES_N) as door:
            await asyncio.wait_for(test(door, port), 30)

    asyncio.run(run())


async def came_in(port: int, crowd: ExitStack) -> socket.socket:
    """A caller that was let in."""
    made = crowd.enter_context(socket.socket())
    made.setblocking(False)
    loop = asyncio.get_running_loop()
    await loop.sock_connect(made, ("127.0.0.1", port))
    assert await loop.sock_recv(made, len(WELCOME)) == WELCOME
    return made


def stays(caller: socket.socket) -> bool:
    try:
        return caller.recv(1) != b""
    except BlockingIOError:
        return True


def test_the_oldest_stranger_makes_room_and_who_is_known_stays(crowd: ExitStack) -> None:
    async def test(door: Door, port: int) -> None:
        known = [await came_in(port, crowd) for _ in range(2)]
        for caller in door._callers:
            door.knows(caller)
        strangers = [await came_in(port, crowd) for _ in range(3 * PLACES_N)]
        await asyncio.sleep(0.05)
        assert all(map(stays, known))
        assert list(map(stays, strangers)) == [False] * 20 + [True] * 4

    behind_a_door(test)


def test_at_most_half_of_the_places_are_for_who_is_known(crowd: ExitStack) -> None:
    async def test(door: Door, port: int) -> None:
        for _ in range(3 * PLACES_N):
            await came_in(port, crowd)
            for caller in door._callers:
                door.knows(caller)
            assert len(door._callers) <= PLACES_N
        assert sum(caller.known for caller in door._callers) == PLACES_N // 2
        assert await came_in(port, crowd)

    behind_a_door(test)


def test_a_crowd_that_comes_at_once_takes_no_more_handles_than_are_let_in(crowd: ExitStack) -> None:
    async def test(door: Door, port: int) -> None:
        callers = [crowd.enter_context(socket.socket()) for _ in range(100)]
        before, most = _handles(), 0
        for caller in callers:
            caller.setblocking(False)
            caller.connect_ex(("127.0.0.1", port))
        for _ in range(300):
            await asyncio.sleep(0)
            most = max(most, _handles())
        assert len(door._callers) == PLACES_N // 2
        assert before < most <= before + PLACES_N // 2 + 2

    behind_a_door(test)


def test_handles_are_left_for_the_run(crowd: ExitStack) -> None:
    """Half of them: a newcomer then takes the place of a stranger, or stays outside."""
    usual = resource.getrlimit(resource.RLIMIT_NOFILE)

    async def test(door: Door, port: int) -> None:
        first = await came_in(port, crowd)
        with socket.socket() as newest:
            resource.setrlimit(resource.RLIMIT_NOFILE, (2 * newest.fileno(), usual[1]))
        try:
            second = await came_in(port, crowd)
            assert not stays(first)
            for caller in door._callers:
                door.knows(caller)
            with pytest.raises((AssertionError, ConnectionError)):
                await came_in(port, crowd)
            assert stays(second)
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, usual)

    behind_a_door(test)


def test_its_end_hangs_up_on_everybody(crowd: ExitStack) -> None:
    held: list[socket.socket] = []

    async def test(_: Door, port: int) -> None:
        held.extend([await came_in(port, crowd) for _ in range(3)])

    behind_a_door(test)
    assert not any(map(stays, held))


@pytest.mark.parametrize("steps", range(6))
def test_who_comes_as_the_door_closes_is_hung_up_on(crowd: ExitStack, steps: int) -> None:
    async def comes(_: Door, port: int) -> None:
        crowd.enter_context(socket.create_connection(("127.0.0.1", port)))
        for _step in range(steps):  # of the loop: it is accepted in one of them, and served in a later one
            await asyncio.sleep(0)

    with warnings.catch_warnings():
        warnings.simplefilter("error", ResourceWarning)
        behind_a_door(comes)
        gc.collect()


def _handles() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))
