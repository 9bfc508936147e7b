"""Signals of a PLC by Modbus TCP: a client that others wrote, silence, strangers."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from bracket_cell.skills.drivers.settings import ModbusSignalSettings
from bracket_ground.errors import DeviceFault, InputError
from bracket_ground.interfaces.clock import ManualClock

pytest.importorskip("pymodbus", reason="the extra robotiq is not installed")
from pymodbus.client import ModbusTcpClient

from bracket_cell.plant.modbus_signals import ModbusSignals

SETTINGS: dict[str, Any] = {"inputs": {"start": 0, "recipe_1": 40}, "outputs": {"running": 0, "fault": 17, "last": 255}}


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port: int = free.getsockname()[1]
        return port


@pytest.fixture
def clock() -> ManualClock:
    return ManualClock()


@pytest.fixture
def signals(clock: ManualClock) -> Iterator[ModbusSignals]:
    made = ModbusSignals(ModbusSignalSettings(at=f"127.0.0.1:{free_port()}", **SETTINGS), clock)
    yield made
    made.close()
    made.close()


@pytest.fixture
def plc(signals: ModbusSignals) -> Iterator[ModbusTcpClient]:
    host, _, port = signals._settings.at.partition(":")
    with ModbusTcpClient(host, port=int(port), timeout=5) as client:
        yield client


def until(holds: Callable[[], bool]) -> None:
    end_s = time.monotonic() + 10.0
    while not holds():
        assert time.monotonic() < end_s, "it did not come"
        time.sleep(0.01)


def test_outputs_are_read_and_inputs_are_written(signals: ModbusSignals, plc: ModbusTcpClient) -> None:
    assert signals.read() == {"running": False, "fault": False, "last": False}
    for name in ("running", "fault", "last"):
        signals.write(name, True)
    read = plc.read_discrete_inputs(0, count=256).bits
    assert [number for number, bit in enumerate(read) if bit] == [0, 17, 255]
    assert plc.read_discrete_inputs(17, count=1).bits[0]
    assert not plc.write_coil(0, True).isError()
    until(lambda: signals.read().get("start") is True)
    assert "recipe_1" not in signals.read(), "nobody wrote it yet"
    assert not plc.write_coils(32, [False] * 8 + [True]).isError()
    until(lambda: signals.read().get("recipe_1") is True)
    assert not plc.write_coil(0, False).isError()
    until(lambda: signals.read().get("start") is False)


def test_what_is_not_there_is_refused(signals: ModbusSignals, plc: ModbusTcpClient) -> None:
    assert plc.read_discrete_inputs(250, count=30).isError()
    assert plc.write_coil(999, True).isError()
    with pytest.raises(DeviceFault, match="no output 'start'; there are: running, fault, last"):
        signals.write("start", True)


def test_a_plc_that_is_silent_is_a_fault_until_it_asks_again(
    signals: ModbusSignals, plc: ModbusTcpClient, clock: ManualClock
) -> None:
    plc.read_discrete_inputs(0, count=1)
    until(lambda: bool(signals.read()))
    clock.sleep_until(clock.now_s() + 1.5)
    with pytest.raises(DeviceFault, match=r"asked and wrote nothing for 1\.5 s"):
        signals.read()
    plc.read_discrete_inputs(0, count=1)
    assert signals.read()


def test_requests_that_come_together_are_all_answered(signals: ModbusSignals, plc: ModbusTcpClient) -> None:
    host, _, port = signals._settings.at.partition(":")
    write, read = bytes.fromhex("00010000000601050000ff00"), bytes.fromhex("000200000006010100000001")
    with socket.create_connection((host, int(port)), 5) as other, other.makefile("rb") as answers:
        other.sendall((write + read) * 8)
        assert answers.read(8 * 22) == (write + bytes.fromhex("00020000000401010101")) * 8
    assert signals.read()["start"]
    assert not plc.read_coils(0, count=1).isError()


@pytest.mark.parametrize(
    ("request_hex", "answer_hex"),
    [
        ("0500000001", "8503"),
        ("0500001234", "8503"),
        ("05000000", "8503"),
        ("0500", "8503"),
        ("05000000ff00ff", "8503"),
        ("0500fff000", "8503"),
        ("0500fff00000", "8503"),
        ("05ffffff00", "8502"),
        ("0f00f8000901ff", "8f03"),
        ("0f00f8000902ffff", "8f02"),
        ("0f0000000000", "8f03"),
        ("0f", "8f03"),
        ("0200000000", "8203"),
        ("02000007d1", "8203"),
        ("0300000001", "8301"),
        ("80", "8001"),
    ],
)
def test_an_illegal_request_changes_nothing(signals: ModbusSignals, request_hex: str, answer_hex: str) -> None:
    before = signals.read()
    assert signals._answer(bytes.fromhex(request_hex)).hex() == answer_hex
    assert signals.read() == before


@pytest.mark.parametrize("words", [b"GET / HTTP/1.1\r\n\r\n", b"\x00" * 7, b"\xff" * 300, b""])
def test_strangers_stay_outside(signals: ModbusSignals, words: bytes) -> None:
    host, _, port = signals._settings.at.partition(":")
    with socket.create_connection((host, int(port)), 5) as stranger:
        stranger.sendall(words)
        stranger.shutdown(socket.SHUT_WR)
        stranger.settimeout(10)
        assert stranger.recv(64) == b""
    with ModbusTcpClient(host, port=int(port), timeout=5) as client:
        assert not client.read_discrete_inputs(0, count=1).isError()


def test_a_port_that_is_taken_is_told(clock: ManualClock) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other, pytest.raises(InputError, match=r"devices\.signals\.at"):
        ModbusSignals(ModbusSignalSettings(at=f"127.0.0.1:{other.getsockname()[1]}"), clock)
