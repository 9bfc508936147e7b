"""The numbers of a run by OPC UA: they can be read, and not written."""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterator
from contextlib import ExitStack, suppress

import pytest

from bracket_cell.production.book import Book, RunRow
from bracket_cell.production.bookkeeper import Bookkeeper
from bracket_cell.production.samples import Samples
from bracket_cell.viewing.door import GREETING_S
from bracket_cell.viewing.gate import Address
from bracket_ground.errors import InputError

sync = pytest.importorskip("asyncua.sync", reason="the extra opcua is not installed")
from bracket_cell.viewing.opcua_server import OpcuaServer  # noqa: E402 - without the extra it is of no use

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore")]  # the library makes its address space in seconds

HELLO = struct.pack("<4s7I", b"HELF", 32, 0, 65535, 65535, 0, 0, 0)


def numbers() -> Samples:
    """Of a run that has just begun."""
    keeper = Bookkeeper(Book(), RunRow(""))
    return Samples(keeper.book, keeper)


@pytest.fixture
def server() -> Iterator[OpcuaServer]:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    made = OpcuaServer(numbers(), Address(port, option="--open opcua"))
    yield made
    made.abandon()


def test_a_client_reads_the_numbers_and_cannot_write_them(server: OpcuaServer) -> None:
    with sync.Client(server.address) as client:
        state = client.get_node("ns=2;s=cell_state.running")
        assert state.read_value() == 1.0
        with pytest.raises(Exception, match=r"UserAccessDenied|denied|not permit"):
            state.write_value(0.0)


def test_clients_are_told_of_the_address_that_people_type(server: OpcuaServer) -> None:
    told = sync.Client(server.address).connect_and_get_server_endpoints()
    assert {endpoint.EndpointUrl for endpoint in told} == {server.address}


@pytest.mark.parametrize(
    "begun", [b"", b"HELF\xff\xff\xff\x00", b"GET / HTTP/1.1\r\n\r\n" + b" " * 32, HELLO, HELLO[:-1]]
)
def test_half_greetings_take_no_more_than_their_places(server: OpcuaServer, begun: bytes) -> None:
    """Whatever they say before a session begins, they are hung up on, and a client comes in meanwhile."""
    host, port = server.address.partition("//")[2].partition("/")[0].split(":")
    with ExitStack() as stack:
        callers = [stack.enter_context(socket.create_connection((host, int(port)), 5)) for _ in range(200)]
        for one in callers:
            with suppress(ConnectionError):
                one.sendall(begun)
        with sync.Client(server.address) as client:
            assert client.get_node("ns=2;s=cell_state.running").read_value() == 1.0
        for one in callers:
            one.settimeout(4 * GREETING_S)
            with suppress(ConnectionError):
                while one.recv(64):
                    pass


def test_a_port_that_is_taken_is_told() -> None:
    with (
        socket.create_server(("127.0.0.1", 0)) as taken,
        pytest.raises(InputError, match="--open opcua PORT or HOST:PORT"),
    ):
        OpcuaServer(numbers(), Address(taken.getsockname()[1], option="--open opcua"))
