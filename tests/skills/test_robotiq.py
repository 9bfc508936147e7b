"""The two wires of a Robotiq gripper against their twins: the contract, and what a wire or the power does wrong."""

from __future__ import annotations

import re
import termios
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from pymodbus.client import ModbusSerialClient
from pymodbus.exceptions import ConnectionException

from bracket_cell.skills.drivers import robotiq
from bracket_cell.skills.drivers.robotiq import ModbusGripper, RegisterGripper, Request, Status, UrcapGripper, UrcapWire
from bracket_cell.skills.drivers.settings import RobotiqModbusSettings, RobotiqUrcapSettings
from bracket_ground.contracts import gripper as gripper_contract
from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.clock import WallClock
from bracket_ground.interfaces.command import GripperCommand
from bracket_ground.interfaces.observation import GripperState, ObjectStatus
from bracket_sim.twin.gripper import CLOSED_COUNT, OPEN_COUNT, ModbusTwin, Registers, UrcapTwin
from tests.skills.ideal_fingers import AnsweredClock, IdealFingers

LOST_S, PATIENCE_S = 0.5, 10.0


@dataclass
class Rig:
    """A driver and the twin at the other end of its wire."""

    clock: AnsweredClock
    fingers: IdealFingers
    registers: Registers
    twin: ModbusTwin | UrcapTwin
    open: Callable[[], RegisterGripper]
    gripper: RegisterGripper

    @property
    def bench(self) -> gripper_contract.Bench:
        def put(width_m: float) -> None:
            self.fingers.part_m = width_m

        return gripper_contract.Bench(self.gripper, self.clock, put, speed_m_s=(0.020, 0.150), force_n=(20.0, 235.0))

    def until(self, holds: Callable[[], bool]) -> None:
        """Wait for something that has no time of its own."""
        end_s = self.clock.now_s() + PATIENCE_S
        while not holds():
            assert self.clock.now_s() < end_s, "never"
            self.clock.sleep_until(self.clock.now_s() + 0.04)

    def anew(self) -> GripperState:
        """A state that was told after now."""
        known = self.gripper.exchanges
        self.until(lambda: self.gripper.exchanges > known + 1)
        return self.gripper.state()

    def fault(self) -> str:
        """What the driver raises before long."""
        told: list[str] = []

        def raised() -> bool:
            try:
                self.gripper.state()
            except DeviceFault as error:
                told.append(str(error))
            return bool(told)

        self.until(raised)
        return told[0]


Opened = tuple[ModbusTwin | UrcapTwin, Callable[[], RegisterGripper]]


def modbus(tmp_path: Path, clock: AnsweredClock, registers: Registers) -> Opened:
    port = tmp_path / "by-id" / "usb-FTDI"
    settings = RobotiqModbusSettings(port=str(port), lost_s=LOST_S)
    return ModbusTwin(registers, port), lambda: ModbusGripper(settings, clock)


def urcap(_: Path, clock: AnsweredClock, registers: Registers) -> Opened:
    twin = UrcapTwin(registers, "127.0.0.1", 0)
    settings = RobotiqUrcapSettings(host="127.0.0.1", port=twin.port, lost_s=LOST_S)
    return twin, lambda: UrcapGripper(settings, clock)


def opened(wire: Callable[[Path, AnsweredClock, Registers], Opened], tmp_path: Path) -> Iterator[Rig]:
    clock = AnsweredClock()
    fingers = IdealFingers(clock)
    registers = Registers(fingers, threading.RLock(), stroke_m=0.085)
    twin, opening = wire(tmp_path, clock, registers)
    made = Rig(clock, fingers, registers, twin, opening, opening())
    clock.answered = lambda: made.gripper.exchanges
    yield made
    made.gripper.close()
    twin.close()


@pytest.fixture(autouse=True)
def _no_pauses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(robotiq, "PERIOD_S", 0.001)


@pytest.fixture(params=[modbus, urcap], ids=["modbus", "urcap"])
def rig(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Rig]:
    yield from opened(request.param, tmp_path)


@pytest.fixture
def adapter(tmp_path: Path) -> Iterator[Rig]:
    yield from opened(modbus, tmp_path)


@pytest.mark.long
@pytest.mark.contract
@pytest.mark.parametrize("check", gripper_contract.CHECKS)
def test_contract(rig: Rig, check: Callable[[gripper_contract.Bench], None]) -> None:
    check(rig.bench)


def test_registers_are_packed_as_the_manual_says() -> None:
    assert Request(True, True, 255, 255, 255).data == bytes.fromhex("0900 00FF FFFF")
    status = Status.of(bytes.fromhex("B900 00FF BD0A"))  # the manual: a part is held
    assert (status.active, status.going, status.state) == (True, True, 3)
    assert status.object_status is ObjectStatus.CONTACT_CLOSING
    assert (status.fault, status.echo, status.position, status.current) == (0, 0xFF, 0xBD, 0x0A)


def test_activation_measures_where_the_fingers_end(rig: Rig) -> None:
    rig.gripper.ends = 0, 240
    rig.bench.activated()
    assert rig.gripper.ends == (OPEN_COUNT, CLOSED_COUNT)
    assert rig.gripper.measured


def test_a_part_is_not_taken_for_the_end_of_the_fingers(rig: Rig) -> None:
    rig.fingers.part_m = 0.030
    rig.bench.activated()
    assert rig.gripper.ends == (OPEN_COUNT, CLOSED_COUNT)
    assert rig.gripper.state().opening_m == pytest.approx(0.085)


def test_fingers_that_met_each_other_hold_nothing(rig: Rig) -> None:
    rig.bench.activated()
    rig.gripper.command(GripperCommand(0.0))
    assert rig.bench.settle().object_status is ObjectStatus.AT_POSITION


def test_it_is_never_activated_unasked(rig: Rig) -> None:
    rig.anew()
    assert not rig.gripper.state().activated
    assert rig.fingers.requests == []


def test_an_active_gripper_is_adopted_with_what_it_holds(rig: Rig) -> None:
    rig.bench.activated()
    rig.fingers.part_m = 0.034
    rig.gripper.command(GripperCommand(0.0))
    assert rig.bench.settle().holding
    rig.gripper.close()
    rig.gripper = rig.open()
    state = rig.anew()
    assert state.activated
    assert state.holding
    assert all(request["rACT"] for request in rig.fingers.requests[-3:])
    assert state.opening_m == pytest.approx(0.034, abs=0.001)


@pytest.mark.long
@pytest.mark.parametrize("holding", [True, False])
def test_one_that_lost_its_power_is_left_alone(rig: Rig, holding: bool) -> None:
    rig.bench.activated()
    rig.fingers.part_m = 0.034 if holding else None
    rig.gripper.command(GripperCommand(0.0))
    assert rig.bench.settle().holding is holding
    rig.registers.power(False)
    rig.clock.sleep_until(rig.clock.now_s() + 0.04)
    rig.registers.power(True)
    assert not rig.anew().activated
    assert not rig.fingers.requests[-1]["rACT"]
    rig.fingers.part_m = None
    rig.bench.activated()


def test_without_power_it_is_lost_and_found(adapter: Rig) -> None:
    adapter.registers.power(False)
    assert "no answer for" in adapter.fault()
    adapter.registers.power(True)
    adapter.anew()
    adapter.bench.activated()


@pytest.mark.parametrize("what", ["lose", "damage"])
def test_a_lost_or_damaged_answer_is_no_lost_gripper(adapter: Rig, what: str) -> None:
    adapter.bench.activated()
    setattr(adapter.twin, what, 3)
    adapter.until(lambda: getattr(adapter.twin, what) == 0)
    assert adapter.anew().activated
    assert adapter.gripper.state().bus_errors == ""


def test_an_adapter_that_comes_back_as_another_terminal_goes_on(adapter: Rig) -> None:
    adapter.bench.activated()
    assert isinstance(adapter.twin, ModbusTwin)
    adapter.twin.replug()
    state = adapter.anew()
    assert state.activated
    adapter.gripper.command(GripperCommand(0.020))
    assert adapter.bench.settle().opening_m == pytest.approx(0.020, abs=0.001)


def test_a_fault_that_must_be_reset_is_raised_until_then(rig: Rig) -> None:
    rig.bench.activated()
    rig.fingers.fault = 0x0E
    assert "fault 0x0E: overcurrent" in rig.fault()
    rig.fingers.fault = 0
    rig.bench.activated()


def test_nobody_at_the_other_end(tmp_path: Path) -> None:
    clock = AnsweredClock()
    with pytest.raises(DeviceFault, match="cannot be opened"):
        ModbusGripper(RobotiqModbusSettings(port=str(tmp_path / "none")), clock)
    with pytest.raises(DeviceFault, match="cannot be opened"):
        UrcapGripper(RobotiqUrcapSettings(host="127.0.0.1", port=1), clock)


def test_pymodbus_reads_and_writes_the_twin(adapter: Rig) -> None:
    adapter.gripper.close()
    assert isinstance(adapter.twin, ModbusTwin)
    client = ModbusSerialClient(adapter.twin.banner.split()[-1], baudrate=115_200, timeout=1.0)
    assert client.connect()
    assert client.write_registers(0x03E8, [0x0900, 0x00FF, 0xFFFF], device_id=9).registers == []
    assert client.write_register(0x03E9, 0x0010, device_id=9).registers == [0x0010]
    for read in (client.read_holding_registers, client.read_input_registers):
        first, fault_echo, _ = read(0x07D0, count=3, device_id=9).registers
        assert first >> 8 & 9 == 9
        assert fault_echo == 0x0010
    client.close()  # type: ignore[no-untyped-call]
    adapter.gripper = adapter.open()


@pytest.mark.parametrize("error", [ConnectionException("ModbusSerialClient"), OSError("write failed: (5, 'x')")])
def test_a_port_that_is_gone_is_told_without_words_of_a_library(
    error: Exception, adapter: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    adapter.gripper.close()

    def gone(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(ModbusSerialClient, "read_holding_registers", gone)
    wire = robotiq.ModbusWire(adapter.twin.banner.split()[-1], 115_200, 9)
    with pytest.raises(ConnectionError, match=r"^\S+ cannot be used any more$"):
        wire.read()
    wire.close()
    monkeypatch.undo()
    adapter.gripper = adapter.open()


def test_a_wire_that_hangs_is_let_go_of_within_a_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    waiting, closed = threading.Event(), threading.Event()

    class Hanging:
        def read(self) -> bytes:
            waiting.wait(20)
            raise OSError("over")

        def write(self, command: bytes) -> None:
            """Nobody writes."""

        def close(self) -> None:
            closed.set()

    monkeypatch.setattr(robotiq, "CLOSES_S", 0.1)
    gripper = RegisterGripper(RobotiqModbusSettings(port="nowhere"), WallClock(), Hanging)
    began_s = time.monotonic()
    gripper.close()
    assert time.monotonic() - began_s < 5
    waiting.set()
    assert closed.wait(5)


def test_a_wire_that_raises_anything_is_opened_again_and_says_why() -> None:
    opened: list[int] = []

    class Odd:
        def read(self) -> bytes:
            if len(opened) < 3:
                raise termios.error(5, "Input/output error")
            return bytes((0x31, 0, 0, 0, 3, 0))

        def write(self, command: bytes) -> None:
            """Taken."""

        def close(self) -> None:
            raise OSError("it is gone")

    def open_odd() -> Odd:
        opened.append(1)
        return Odd()

    clock = WallClock()
    gripper = RegisterGripper(RobotiqModbusSettings(port="nowhere"), clock, open_odd)
    told: set[str] = set()
    until_s = clock.now_s() + 10
    while not gripper.exchanges and clock.now_s() < until_s:
        told.add(gripper._trouble)
        clock.sleep_until(clock.now_s() + 0.01)
    assert gripper.state().activated
    assert "Input/output error" in told
    gripper.close()


@pytest.mark.parametrize(("name", "value"), [("STA", 7), ("STA", 99), ("OBJ", 4), ("GTO", 2), ("POS", 300)])
def test_a_value_that_the_field_cannot_have_is_no_status(
    monkeypatch: pytest.MonkeyPatch, name: str, value: int
) -> None:
    values = {"ACT": 1, "GTO": 1, "STA": 3, name: value}

    def answered(_: UrcapWire, line: str, answer: bytes) -> re.Match[bytes] | None:
        return re.fullmatch(answer, f"{line[4:]} {values.get(line[4:], 0)}".encode())

    monkeypatch.setattr(UrcapWire, "_ask", answered)
    with pytest.raises(ConnectionError, match=f"'GET {name}' is answered with {value}"):
        UrcapWire.__new__(UrcapWire).read()
