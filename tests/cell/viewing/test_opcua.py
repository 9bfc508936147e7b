"""The numbers of a run by OPC UA: they can be read, and not written."""

from __future__ import annotations

import socket

import pytest

from cell.errors import InputError
from cell.viewing.gate import Address
from cell.viewing.production import Production

sync = pytest.importorskip("asyncua.sync", reason="the extra opcua is not installed")
from cell.viewing.opcua_server import OpcuaServer  # noqa: E402 - without the extra it is of no use

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore")]  # the library makes its address space in seconds


def test_a_client_reads_the_numbers_and_cannot_write_them() -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    server = OpcuaServer(Production(), Address(port, option="--opcua"))
    try:
        with sync.Client(server.address) as client:
            state = client.get_node("ns=2;s=cell_state.running")
            assert state.read_value() == 1.0
            with pytest.raises(Exception, match=r"UserAccessDenied|denied|not permit"):
                state.write_value(0.0)
    finally:
        server.abandon()


def test_a_port_that_is_taken_is_told() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken, pytest.raises(InputError, match="--opcua PORT or HOST:PORT"):
        OpcuaServer(Production(), Address(taken.getsockname()[1], option="--opcua"))
