"""Robotiq 2F-85: the registers' logic once, and two wires to them: Modbus RTU and the URCap's text socket.

Command bytes: rACT, rGTO | - | - | rPR | rSP | rFR. Status bytes: gACT, gGTO, gSTA, gOBJ | - | gFLT | gPR | gPO | gCU.
"""

from __future__ import annotations

import logging
import re
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import Enum, auto
from pathlib import Path
from typing import Protocol

from pymodbus.client import ModbusSerialClient
from pymodbus.exceptions import ModbusException, ModbusIOException
from pymodbus.pdu import ModbusPDU

from bracket_cell.skills.drivers.can_gripper import ACTIVE, ADOPTION_S, MAJOR_FAULT, NO_COMMUNICATION
from bracket_cell.skills.drivers.settings import FingerSettings, RobotiqModbusSettings, RobotiqUrcapSettings
from bracket_ground.errors import DeviceFault, LatchedFault, words_of
from bracket_ground.interfaces.clock import Clock
from bracket_ground.interfaces.command import GripperCommand
from bracket_ground.interfaces.devices import DeviceCheck
from bracket_ground.interfaces.gripper import default_gripper
from bracket_ground.interfaces.observation import GripperState, NodeState, ObjectStatus
from bracket_ground.interfaces.robot import RobotModel

PERIOD_S = 0.02  # between exchanges; the gripper takes 200 a second at most
ANSWER_S = 0.05  # in which an answer comes, or is lost
KEEP_ALIVE_S = 0.2  # the gripper faults after 1 s without a command
RETRY_S = 0.1  # after which a wire is opened again
CLOSES_S = 2.0  # in which it is let go of; an operating system may hold a port for longer
END_COUNTS = 2  # so near their end, fingers that say that they met something have met each other
MOST = {"ACT": 1, "GTO": 1, "STA": 3, "OBJ": 3}  # of the fields of one byte; others have a byte each
COMMAND_REGISTER, STATUS_REGISTER, REGISTERS = 0x03E8, 0x07D0, 3
ADOPTED_COUNT = 48  # force (60 N) and speed with which an adopted gripper goes on; its status does not tell
FAULTS = {
    0x05: "action delayed until it is activated again",
    0x07: "it is not activated",
    0x08: "too hot",
    0x09: "it heard nothing for 1 s",
    0x0A: "supply voltage too low",
    0x0B: "automatic release under way",
    0x0C: "internal fault",
    0x0D: "activation failed",
    0x0E: "overcurrent",
    0x0F: "automatic release is done",
}
STILL_READS = 5  # of one position, until fingers count as at their end
FAILURES = 5  # exchanges in a row, after which a wire is opened again although it says nothing
NEAR_COUNTS = 20  # of where the settings say the fingers end; what ends farther off met something
logging.getLogger("pymodbus").setLevel(logging.CRITICAL)  # what it has to say is raised, too


@dataclass(frozen=True)
class Request:
    """The command registers."""

    activate: bool = False
    go: bool = False
    position: int = 0
    speed: int = ADOPTED_COUNT
    force: int = ADOPTED_COUNT

    @property
    def data(self) -> bytes:
        return bytes((self.activate | self.go << 3, 0, 0, self.position, self.speed, self.force))


@dataclass(frozen=True)
class Status:
    """The status registers."""

    active: bool
    going: bool
    state: int
    object_status: ObjectStatus
    fault: int
    echo: int
    position: int
    current: int

    @classmethod
    def of(cls, data: bytes) -> Status:
        """Of the six bytes."""
        first = data[0]
        status = ObjectStatus(first >> 6)
        return cls(bool(first & 1), bool(first & 8), first >> 4 & 3, status, data[2] & 0x0F, *data[3:6])

    def repeats(self, request: Request) -> bool:
        """Whether it is an answer to this command; else it is an older one."""
        return (self.active, self.going, self.echo) == (request.activate, request.go, request.position)


class Step(Enum):
    """Of an activation."""

    RESET, HOMING, CLOSING, OPENING = auto(), auto(), auto(), auto()


REQUESTS = {
    Step.RESET: Request(),
    Step.HOMING: Request(activate=True),
    Step.CLOSING: Request(True, True, 255),
    Step.OPENING: Request(True, True, 0),
}


class Wire(Protocol):
    """A way to the registers."""

    def read(self) -> bytes:
        """The six status bytes; raises OSError."""
        ...

    def write(self, command: bytes) -> None:
        """Set the six command bytes; raises OSError."""
        ...

    def close(self) -> None:
        """Let go of it."""
        ...


class RegisterGripper:
    """Implements `Gripper` on any wire; a thread exchanges registers all the time, so that no call waits.

    A gripper that is active already is adopted as it is. One that lost its power is left alone: nothing activates it
    again but `activate`, which also measures where its fingers end. A wire that broke is opened again.

    Args:
        open_wire: raises OSError where it cannot be had.

    Attributes:
        ends: position register of open and of closed fingers.
        measured: the ends were measured since it was opened.
        exchanges: how many were answered.
    """

    def __init__(
        self, settings: FingerSettings, clock: Clock, open_wire: Callable[[], Wire], robot: RobotModel | None = None
    ) -> None:
        gripper = default_gripper() if robot is None else robot.gripper
        if gripper.fingers is None:
            raise DeviceFault("gripper", f"{gripper.name} has no fingers, and these registers move such alone")
        self._fingers, self._settings, self._clock, self._open_wire = gripper.fingers, settings, clock, open_wire
        self.ends, self.measured, self.exchanges = (settings.open_count, settings.closed_count), False, 0
        self._lock = threading.Lock()
        self._request = Request()
        self._commanded = False  # somebody did so; until then the registers are read alone
        self._steps: list[Step] = []  # of an activation that is under way
        self._still = 0  # answers in a row in which they rest at one place
        self._status: Status | None = None
        self._status_s = self._opened_s = self._connected_s = clock.now_s()
        self._trouble = "no answer yet"
        self._written: Request | None = None
        self._written_s = 0.0  # of the wall, as the gripper counts
        self._wire: Wire | None = None
        self._closed, self._wake = threading.Event(), threading.Event()
        try:
            self._wire = open_wire()
        except OSError as error:
            raise DeviceFault("gripper", f"cannot be opened: {words_of(error)}") from error
        self._thread = threading.Thread(target=self._run, name="gripper", daemon=True)
        self._thread.start()

    def state(self) -> GripperState:
        """As last told; raises DeviceFault after `lost_s` without an answer, LatchedFault for one to be reset."""
        with self._lock:
            status, told_s, request, steps = self._status, self._status_s, self._request, bool(self._steps)
            connected_s, trouble = self._connected_s, self._trouble
        now_s = self._clock.now_s()
        if now_s - told_s > self._settings.lost_s:
            raise DeviceFault("gripper", f"no answer for {now_s - told_s:.2f} s: {trouble}")
        if status is None:
            return GripperState(
                told_s, False, ObjectStatus.MOVING, self._fingers.stroke_m, 0.0, 0, "unknown", echoed=False
            )
        new = now_s - connected_s <= ADOPTION_S  # it had no master, and says so
        if status.fault >= MAJOR_FAULT and not steps and not (new and status.fault == NO_COMMUNICATION):
            kind = DeviceFault if status.fault == NO_COMMUNICATION else LatchedFault
            raise kind("gripper", f"fault 0x{status.fault:02X}: {FAULTS.get(status.fault, 'unknown')}")
        active = status.active and status.state == ACTIVE and not steps
        echoed = not self._commanded or status.repeats(request)
        met = self._object(status) if echoed else ObjectStatus.MOVING
        opening_m, errors = self._opening_m(status.position), trouble
        node: NodeState = "operational" if active else "pre_operational"
        return GripperState(
            told_s, active, met, opening_m, status.current / 100, status.fault, node, echoed, bus_errors=errors
        )

    def activate(self) -> None:
        """Begin activation: a full open and close, and both ends are measured."""
        with self._lock:
            self._steps = list(Step)
            self._request, self._commanded = REQUESTS[self._steps[0]], True
        self._wake.set()

    def command(self, command: GripperCommand) -> GripperCommand:
        """Start a motion; values beyond the registers' range are cut to it."""
        with self._lock:
            open_count, closed_count = self.ends
            does = self._fingers
            opening_m = min(max(command.opening_m, 0.0), does.stroke_m)
            position = round(closed_count + opening_m / does.stroke_m * (open_count - closed_count))
            speed, force = _count(command.speed_m_s, does.speed_m_s), _count(command.force_n, does.force_n)
            self._request, self._commanded = Request(self._request.activate, True, position, speed, force), True
            position_m = self._opening_m(position)
        self._wake.set()
        return GripperCommand(position_m, _value(speed, does.speed_m_s), _value(force, does.force_n))

    def hold(self) -> None:
        """Clear rGTO: the fingers stop and keep their grip."""
        with self._lock:
            self._request = replace(self._request, go=False)
        self._wake.set()

    def close(self) -> None:
        """Let go of the wire, within two seconds; the gripper keeps what it holds."""
        self._closed.set()
        self._wake.set()
        self._thread.join(CLOSES_S)

    def _opening_m(self, position: int) -> float:
        open_count, closed_count = self.ends
        return min(max((closed_count - position) / (closed_count - open_count), 0.0), 1.0) * self._fingers.stroke_m

    def _object(self, status: Status) -> ObjectStatus:
        """gOBJ; fingers that met each other hold nothing."""
        if status.object_status is ObjectStatus.CONTACT_CLOSING and status.position >= self.ends[1] - END_COUNTS:
            return ObjectStatus.AT_POSITION
        if status.object_status is ObjectStatus.CONTACT_OPENING and status.position <= self.ends[0] + END_COUNTS:
            return ObjectStatus.AT_POSITION
        return status.object_status

    def _run(self) -> None:
        failures = 0
        while not self._closed.is_set():
            try:
                self._exchange()
                failures = 0
            except Exception as error:  # whatever a wire raises, such as termios.error: told, and it is opened again
                failures += 1
                with self._lock:
                    self._trouble = words_of(error)
                if not isinstance(error, TimeoutError) or failures % FAILURES == 0:
                    self._let_go()
            self._wake.wait(RETRY_S if self._wire is None else PERIOD_S)
            self._wake.clear()
        self._let_go()

    def _exchange(self) -> None:
        """Read, then write, which would activate a gripper anew that has just restarted: the thread alone does so."""
        if self._wire is None:
            self._wire = self._open_wire()
        status = Status.of(self._wire.read())
        with self._lock:
            now_s = self._clock.now_s()
            if now_s - self._status_s > ADOPTION_S:
                self._connected_s = now_s
            self._take(status)
            self._status, self._status_s, self._trouble, self.exchanges = status, now_s, "", self.exchanges + 1
            request, commanded = self._request, self._commanded
        if commanded and (request != self._written or time.monotonic() - self._written_s >= KEEP_ALIVE_S):
            self._wire.write(request.data)
            self._written, self._written_s = request, time.monotonic()

    def _take(self, status: Status) -> None:
        """Adopt an active gripper, notice one that restarted, go on with an activation."""
        before = self._status
        if before is None and not self._commanded and status.active and status.state == ACTIVE:
            self._request, self._commanded = Request(True, status.going, status.echo), True
        elif self._steps:
            self._activate(status)
        elif before is not None and before.active and not status.active and self._request.activate:
            self._request, self._commanded, self._written = Request(), False, None

    def _activate(self, status: Status) -> None:
        """Go on to the next step of an activation when one is done."""
        step, (open_count, closed_count) = self._steps[0], self.ends
        if step is Step.RESET:
            done = not status.active and status.state == 0
        elif step is Step.HOMING:
            done = status.active and status.state == ACTIVE
        else:
            rests = status.repeats(self._request) and status.object_status is not ObjectStatus.MOVING
            before = self._status
            self._still = self._still + 1 if rests and before and before.position == status.position else 0
            done = self._still >= STILL_READS
        if not done:
            return
        if step is Step.CLOSING and abs(status.position - self._settings.closed_count) <= NEAR_COUNTS:
            self.ends = open_count, status.position
        if step is Step.OPENING and abs(status.position - self._settings.open_count) <= NEAR_COUNTS:
            self.ends, self.measured = (status.position, closed_count), True
        self._steps.pop(0)
        self._still = 0
        self._request = REQUESTS[self._steps[0]] if self._steps else self._request

    def _let_go(self) -> None:
        wire, self._wire = self._wire, None
        if wire is not None:
            with suppress(OSError):  # it broke: there is nothing left to close
                wire.close()


class ModbusGripper(RegisterGripper):
    """A 2F-85 at an RS-485 adapter."""

    Settings = RobotiqModbusSettings

    def __init__(self, settings: RobotiqModbusSettings, clock: Clock, robot: RobotModel | None = None) -> None:
        super().__init__(settings, clock, lambda: ModbusWire(settings.port, settings.baud, settings.node_id), robot)


class ModbusWire:
    """Implements `Wire` by Modbus RTU, 8N1."""

    def __init__(self, port: str, baud: int, node_id: int) -> None:
        self._node_id, self._port = node_id, port
        self._client = ModbusSerialClient(port, baudrate=baud, timeout=ANSWER_S, retries=0)
        if not self._client.connect():
            raise ConnectionError(f"{port} cannot be opened")

    def read(self) -> bytes:
        """As in `Wire`; a lost or damaged answer is a TimeoutError."""
        ask = self._client.read_holding_registers
        registers = self._answered(lambda: ask(STATUS_REGISTER, count=REGISTERS, device_id=self._node_id)).registers
        if len(registers) != REGISTERS:
            raise TimeoutError(f"{len(registers)} registers in place of {REGISTERS}")
        return b"".join(register.to_bytes(2, "big") for register in registers)

    def write(self, command: bytes) -> None:
        """As in `Wire`, likewise."""
        values = [command[at] << 8 | command[at + 1] for at in range(0, len(command), 2)]
        self._answered(lambda: self._client.write_registers(COMMAND_REGISTER, values, device_id=self._node_id))

    def _answered(self, ask: Callable[[], ModbusPDU]) -> ModbusPDU:
        try:
            answer = ask()
        except ModbusIOException as error:
            raise TimeoutError("no answer, or a damaged one") from error
        except (ModbusException, OSError) as error:
            raise ConnectionError(f"{self._port} cannot be used any more") from error
        if answer.isError():
            raise TimeoutError("it answers that it does not know the registers")
        return answer

    def close(self) -> None:
        """Let go of the port."""
        self._client.close()  # type: ignore[no-untyped-call]


class UrcapGripper(RegisterGripper):
    """A 2F-85 behind the URCap's text socket."""

    Settings = RobotiqUrcapSettings

    def __init__(self, settings: RobotiqUrcapSettings, clock: Clock, robot: RobotModel | None = None) -> None:
        super().__init__(settings, clock, lambda: UrcapWire(settings.host, settings.port), robot)


class UrcapWire:
    """Implements `Wire` by lines of text: SET is answered with ack, GET with the name and its value."""

    def __init__(self, host: str, port: int) -> None:
        self._socket = socket.create_connection((host, port), timeout=1.0)
        self._socket.settimeout(5 * ANSWER_S)

    def read(self) -> bytes:
        """As in `Wire`."""
        names = ("ACT", "GTO", "STA", "OBJ", "FLT", "PRE", "POS", "COU")
        answers = {name: self._ask(f"GET {name}", name.encode() + rb" (\d+)")[1] for name in names}
        registers = {name: int(answer) for name, answer in answers.items()}
        for name, value in registers.items():
            if value > (most := MOST.get(name, 255)):
                raise ConnectionError(f"'GET {name}' is answered with {value}, the most is {most}")
        first = registers["ACT"] | registers["GTO"] << 3 | registers["STA"] << 4 | registers["OBJ"] << 6
        return bytes((first, 0, registers["FLT"], registers["PRE"], registers["POS"], registers["COU"]))

    def write(self, command: bytes) -> None:
        """As in `Wire`; GTO goes with every position, which the pendant may have taken away."""
        first, _, _, position, speed, force = command
        words = f"ACT {first & 1} GTO {first >> 3 & 1} POS {position} SPE {speed} FOR {force}"
        self._ask(f"SET {words}", rb"ack")

    def close(self) -> None:
        """Let go of the socket."""
        self._socket.close()

    def _ask(self, line: str, answer: bytes) -> re.Match[bytes]:
        """One line, one answer; after another one nobody knows which belongs to what."""
        self._socket.sendall(line.encode() + b"\n")
        received = self._socket.recv(1024)
        if (found := re.fullmatch(answer, received.strip())) is None:
            raise ConnectionError(f"{line!r} is answered with {received!r}")
        return found


def examine(settings: RobotiqModbusSettings | RobotiqUrcapSettings) -> Iterator[DeviceCheck]:
    """Whether it answers, what it complains of, and whether its fingers end where the settings say; only reads."""
    serial = isinstance(settings, RobotiqModbusSettings)
    where = settings.port if isinstance(settings, RobotiqModbusSettings) else f"{settings.host}:{settings.port}"
    what = f"gripper at {where}"
    try:
        wire = _opened(settings)
    except OSError as error:
        adapter = "names of adapters: ls /dev/serial/by-id; the user must be in the group dialout"
        urcap = "install the gripper's URCap on the controller, and switch its network service on"
        yield DeviceCheck(what, f"cannot be opened: {words_of(error)}; {adapter if serial else urcap}")
        return
    try:
        status = _looked(wire)
    except TimeoutError:
        yield DeviceCheck(what, "it does not answer: 24 V, baud and node_id, A and B, and no other program at the port")
        return
    except OSError as error:
        yield DeviceCheck(what, f"{words_of(error)}: no such gripper answers; see `devices.gripper`")
        return
    if status.fault >= MAJOR_FAULT and status.fault != NO_COMMUNICATION:
        yield DeviceCheck(what, f"fault 0x{status.fault:02X}, {FAULTS[status.fault]}: switch it off and on")
        return
    yield DeviceCheck(f"{what}{'' if status.state == ACTIVE else ', not active: a run opens and closes it first'}")
    yield _stroke(settings, status)
    timer = Path("/sys/bus/usb-serial/devices", Path(where).resolve().name, "latency_timer")
    if serial and timer.is_file() and (ms := timer.read_text().strip()) != "1":
        yield DeviceCheck(f"gripper: its adapter waits {ms} ms", f"echo 1 | sudo tee {timer}")


def _opened(settings: RobotiqModbusSettings | RobotiqUrcapSettings) -> Wire:
    """The wire; raises OSError."""
    if isinstance(settings, RobotiqModbusSettings):
        return ModbusWire(settings.port, settings.baud, settings.node_id)
    return UrcapWire(settings.host, settings.port)


def _looked(wire: Wire) -> Status:
    """The status, without a command; lets go of the wire, and raises OSError."""
    try:
        for _ in range(FAILURES):
            with suppress(TimeoutError):
                return Status.of(wire.read())
        raise TimeoutError
    finally:
        wire.close()


def _stroke(settings: FingerSettings, status: Status) -> DeviceCheck:
    """Fingers that rest at an end tell where it is."""
    ends = settings.open_count, settings.closed_count
    what = f"gripper: its fingers stand at {status.position} of {ends[0]} (open) to {ends[1]} (closed)"
    beyond = not ends[0] - END_COUNTS <= status.position <= ends[1] + END_COUNTS
    rests = status.going and status.object_status is not ObjectStatus.MOVING
    end = ends[0] if status.echo <= ends[0] else ends[1] if status.echo >= min(ends[1], 250) else None
    if beyond or (rests and end is not None and abs(status.position - end) > END_COUNTS):
        return DeviceCheck(
            what, "take a part out of them; if none is there: `cell setup teach gripper` measures their ends"
        )
    return DeviceCheck(what)


def _count(value: float, limits: tuple[float, float]) -> int:
    """Register of a value, cut to its limits."""
    low, high = limits
    return round((min(max(value, low), high) - low) / (high - low) * 255)


def _value(count: int, limits: tuple[float, float]) -> float:
    return limits[0] + count / 255 * (limits[1] - limits[0])
