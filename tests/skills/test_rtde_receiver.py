"""A controller that sends damaged packages is connected again, with words, and never stops the receiver."""

from __future__ import annotations

import random
import socket
import struct
import threading
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from bracket_cell.skills.drivers import rtde
from bracket_cell.skills.drivers.rtde import RtdeConnection
from bracket_cell.skills.drivers.samples import SampleReceiver
from bracket_cell.skills.drivers.ur import OUTPUTS, UrSamples
from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.clock import WallClock
from tests.skills.rtde_server import RtdeServer, package

TYPES = ["DOUBLE", *["VECTOR6D"] * 3, *["INT32"] * 2, "UINT32", "DOUBLE", "DOUBLE", "VECTOR6D"]


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[RtdeServer]:
    serving = RtdeServer(TYPES)
    monkeypatch.setattr(rtde, "PORT", serving.port)
    yield serving
    serving.close()


def sound(number: int, safety: int = 1) -> bytes:
    values = (0.008 * number, *(0.0,) * 18, 7, safety, 2, 1.0, 1.0, *(0.0,) * 6)
    return package("U", b"\1" + struct.pack(">19diiI8d", *values))


DAMAGED: dict[str, Callable[[], bytes]] = {
    "a double short": lambda: package("U", sound(1)[4:-8]),
    "a byte long": lambda: package("U", sound(1)[3:] + b"\0"),
    "size 0": lambda: b"\0\0U",
    "size 2": lambda: b"\0\2U",
    "empty": lambda: package("U", b""),
    "noise": lambda: random.Random(1).randbytes(4096),
}


@pytest.mark.parametrize("name", DAMAGED)
def test_a_damaged_package_is_a_new_connection_and_samples_go_on(server: RtdeServer, name: str) -> None:
    receiver = SampleReceiver(lambda: UrSamples("127.0.0.1", 2.0, np.eye(3)), WallClock(), "127.0.0.1")
    try:
        server.say(sound(0))
        first = receiver.newest
        server.say(DAMAGED[name](), hang=True)
        server.await_connections(2)
        for number in range(1, 4):
            server.say(sound(number))
        assert wait_for(lambda: receiver.newest.time_s > first.time_s)
        assert receiver.trouble == ""
    finally:
        receiver.close()
    assert not receiver._thread.is_alive()


@pytest.mark.parametrize(
    ("number", "mode", "reason"),
    [
        (1, "normal", ""),
        (2, "reduced", ""),
        (5, "safeguard_stop", "the controller is in safeguard stop"),
        (6, "emergency_stop", "the controller is in system emergency stop"),
        (7, "emergency_stop", "the controller is in robot emergency stop"),
        (13, "safeguard_stop", "the controller is in system three position enabling stop"),
        (14, "safeguard_stop", "the controller is in tp three position enabling stop"),
        (21, "fault", "the controller is in an unknown safety mode, 21"),
        (-1, "fault", "the controller is in an unknown safety mode, -1"),
    ],
)
def test_a_safety_mode_is_told_by_its_makers_name(server: RtdeServer, number: int, mode: str, reason: str) -> None:
    samples = UrSamples("127.0.0.1", 2.0, np.eye(3))
    server.say(sound(0, number))
    told = samples.receive()
    samples.close()
    assert (told.mode, told.reason) == (mode, reason)


def wait_for(true: Callable[[], bool], limit_s: float = 5.0) -> bool:
    """Whether it becomes true in time."""
    beside = threading.Event()
    return any(true() or beside.wait(0.02) for _ in range(round(limit_s / 0.02)))


def test_a_damaged_package_is_told_in_words(server: RtdeServer) -> None:
    connection = RtdeConnection("127.0.0.1", OUTPUTS)
    server.say(b"\0\0U")
    with pytest.raises(ConnectionError, match="a package of 0 bytes, the least is 3"):
        connection.values()
    server.say(package("U", b"\1" * 9))
    connection.close()


def test_one_that_is_too_short_says_how_long_it_should_be(server: RtdeServer) -> None:
    connection = RtdeConnection("127.0.0.1", OUTPUTS)
    server.say(package("U", b"\1" * 9))
    with pytest.raises(ConnectionError, match="8 bytes of data where 228 belong"):
        connection.values()
    connection.close()


@pytest.mark.parametrize("types", [TYPES[:-1], [*TYPES, "INT32"], []])
def test_other_types_than_asked_for_are_told_in_words(server: RtdeServer, types: list[str]) -> None:
    server.types = types
    with pytest.raises(DeviceFault, match=r"no controller answers at 127.0.0.1: it answers \d+ types to 10"):
        SampleReceiver(lambda: UrSamples("127.0.0.1", 2.0, np.eye(3)), WallClock(), "127.0.0.1")


def test_one_that_answers_fewer_types_when_it_is_connected_again_is_asked_until_it_does_not(
    server: RtdeServer,
) -> None:
    receiver = SampleReceiver(lambda: UrSamples("127.0.0.1", 2.0, np.eye(3)), WallClock(), "127.0.0.1")
    try:
        server.say(sound(0))
        first = receiver.newest
        server.types = TYPES[:-1]
        server.say(b"\0\0U", hang=True)
        assert wait_for(lambda: "9 types to 10 outputs" in receiver.trouble)
        server.types = TYPES
        server.await_connections(2)
        server.say(sound(1))
        assert wait_for(lambda: receiver.newest.time_s > first.time_s)
    finally:
        receiver.close()


def test_one_that_talks_of_other_things_alone_is_given_up_within_the_limit(server: RtdeServer) -> None:
    connection = RtdeConnection("127.0.0.1", OUTPUTS, limit_s=0.2)
    talking = threading.Event()

    def talk() -> None:
        while not talking.wait(0.001):
            server.say(package("M", b"hello"))

    thread = threading.Thread(target=talk)
    thread.start()
    try:
        with pytest.raises(TimeoutError, match=r"no package 'U' came within 0\.2 s|timed out"):
            connection.values()
    finally:
        talking.set()
        thread.join()
        connection.close()


def test_a_connection_that_could_not_begin_is_closed(server: RtdeServer, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[socket.socket] = []
    create = socket.create_connection

    def kept(*given: Any) -> socket.socket:
        made.append(create(*given))
        return made[-1]

    monkeypatch.setattr(socket, "create_connection", kept)
    server.types = TYPES[:-1]
    with pytest.raises(ConnectionError):
        RtdeConnection("127.0.0.1", OUTPUTS)
    assert made[0].fileno() == -1
