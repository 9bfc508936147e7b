"""The twin of a Robotiq 2F-85: its register block over the simulated fingers, and two wires that reach it.

Modbus RTU on a pseudo terminal (functions 3, 4, 6, 16, 23), and the URCap's text socket.
"""

from __future__ import annotations

import asyncio
import logging
import os
import re
import select
import socket
import threading
import time
import tty
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Protocol

from pymodbus.exceptions import ModbusException
from pymodbus.framer import FramerRTU
from pymodbus.pdu import DecodePDU

from bracket_ground.errors import InputError
from bracket_sim.twin.cell import TwinCell
from bracket_sim.twin.sockets import Port

OPEN_COUNT, CLOSED_COUNT = 3, 228  # where the fingers end in the position register
SPEEDS_MM_S, FORCES_N = (20.0, 150.0), (20.0, 235.0)  # of registers 0 and 255
COMMAND_REGISTER, STATUS_REGISTER = 0x03E8, 0x07D0
CONTACT_CLOSING, AT_POSITION = 2, 3  # gOBJ
LOST_S, ANSWER_S = 0.4, 0.05  # in which answers are lost; that a driver waits for each [s of the wall]
LISTEN_S = 0.1  # between looks whether the twin ends
LONGEST = 256
logging.getLogger("pymodbus").setLevel(logging.CRITICAL)  # requests to other nodes are no errors


class Fingers(Protocol):
    """Registers in their physical units, by their names: the simulated node of the gripper."""

    def write(self, request: Mapping[str, float]) -> Mapping[str, float]:
        """Set the command."""
        ...

    def registers(self) -> Mapping[str, float]:
        """The status."""
        ...


class Registers:
    """The six command bytes and the six status bytes of a gripper, under the lock of what moves its fingers.

    Attributes:
        powered: without power it answers nothing, and forgets that it was activated.
    """

    def __init__(self, fingers: Fingers, lock: Any, stroke_m: float) -> None:
        self._fingers, self._lock, self._stroke_mm = fingers, lock, 1e3 * stroke_m
        self._command = bytearray(6)
        self.powered = True

    @property
    def command(self) -> bytes:
        """The command bytes."""
        return bytes(self._command)

    def write(self, at: int, data: bytes) -> None:
        """Set command bytes, and let the fingers follow them all."""
        self._command[at : at + len(data)] = data
        first, _, _, position, speed, force = self._command
        with self._lock:
            self._fingers.write({
                "rACT": first & 1, "rGTO": first >> 3 & 1, "rATR": first >> 4 & 1, "rARD": first >> 5 & 1,
                "rPR": _opening_mm(position, self._stroke_mm),
                "rSP": _value(speed, SPEEDS_MM_S),
                "rFR": _value(force, FORCES_N),
            })  # fmt: skip

    def status(self) -> bytes:
        """As it is now."""
        with self._lock:
            registers = self._fingers.registers()
        asked = self._command[3]
        position = round(CLOSED_COUNT + registers["gPO"] / self._stroke_mm * (OPEN_COUNT - CLOSED_COUNT))
        met = int(registers["gOBJ"])
        if met == AT_POSITION and asked > position + 1:  # the fingers met each other before they were where they go
            met = CONTACT_CLOSING
        first = int(registers["gACT"]) | int(registers["gGTO"]) << 3 | int(registers["gSTA"]) << 4 | met << 6
        return bytes((first, 0, int(registers["gFLT"]), asked, position, min(255, round(100 * registers["gCU"]))))

    def power(self, on: bool) -> None:
        """Take its power away, or give it back."""
        self.powered = on
        self._command = bytearray(6)
        if not on:
            self.write(0, bytes(self._command))


class ModbusTwin:
    """Node 9 at an adapter, whose name is a link to a pseudo terminal.

    Attributes:
        banner: where it listens.
        lose, damage: so many answers from now on are lost, or have a wrong check sum.
    """

    def __init__(self, registers: Registers, port: Path, node_id: int = 9) -> None:
        self._registers, self._port, self._node_id = registers, port, node_id
        self.lose = self.damage = 0
        self.banner = f"gripper: Modbus RTU, node {node_id}, at {port}"
        self._ended = threading.Event()
        self._ends = (-1, -1)
        self.replug()
        self._thread = threading.Thread(target=self._serve, name="modbus", daemon=True)
        self._thread.start()

    def replug(self) -> None:
        """The adapter comes back as another terminal, and its name leads there."""
        master, slave = os.openpty()
        tty.setraw(slave)
        self._unplug()
        try:
            self._port.parent.mkdir(parents=True, exist_ok=True)
            if self._port.is_symlink():
                self._port.unlink()
            self._port.symlink_to(os.ttyname(slave))
        except OSError as error:
            raise InputError(f"{self._port}: cannot be made: {error.strerror or error}") from None
        self._ends = master, slave

    def close(self) -> None:
        """Nobody answers any more."""
        self._ended.set()
        self._thread.join()
        self._unplug()
        self._port.unlink(missing_ok=True)

    async def async_getValues(self, _device: int, _function: int, at: int, count: int) -> list[int]:
        """Registers, as pymodbus asks for them; those that there are not read 0."""
        source = self._registers.status() if at >= STATUS_REGISTER else self._registers.command
        first = 2 * (at - (STATUS_REGISTER if at >= STATUS_REGISTER else COMMAND_REGISTER))
        data = (source + bytes(LONGEST))[max(first, 0) :]
        return [int.from_bytes(data[2 * number : 2 * number + 2], "big") for number in range(count)]

    async def async_setValues(self, _device: int, _function: int, at: int, values: list[int]) -> None:
        """Write registers, likewise; others than those of the command are ignored."""
        if 0 <= (first := 2 * (at - COMMAND_REGISTER)) < 6:
            self._registers.write(first, b"".join(value.to_bytes(2, "big") for value in values)[: 6 - first])

    def _unplug(self) -> None:
        ends, self._ends = self._ends, (-1, -1)
        for end in ends:
            with suppress(OSError):
                os.close(end)

    def _serve(self) -> None:
        framer, loop, came = FramerRTU(DecodePDU(True)), asyncio.new_event_loop(), b""
        while not self._ended.is_set():
            master = self._ends[0]
            try:
                ready, _, _ = select.select([master], [], [], LISTEN_S)
                came = came + os.read(master, LONGEST) if ready else b""
                used, asked = framer.handleFrame(came, self._node_id, 0)
                came = came[used:]
                if asked is not None and self._registers.powered and not self._lost():
                    answer = loop.run_until_complete(asked.datastore_update(self, self._node_id))  # type: ignore[arg-type]
                    answer.dev_id = self._node_id
                    os.write(master, self._sent(framer.buildFrame(answer)))
            except (OSError, ValueError, ModbusException):  # it is being replugged, or does not understand
                came = b""
                self._ended.wait(LISTEN_S)
        loop.close()

    def _lost(self) -> bool:
        self.lose -= (lost := self.lose > 0)
        return lost

    def _sent(self, frame: bytes) -> bytes:
        self.damage -= (damaged := self.damage > 0)
        return frame[:-2] + bytes(2) if damaged else frame


class UrcapTwin(Port):
    """The text socket of the URCap: SET is answered with ack, GET with the name and its value.

    Attributes:
        banner: where it listens.
        mute_until_s: it answers nothing before, by `now_s`.
    """

    FIELDS: Mapping[str, Callable[[bytes], int]] = {
        "ACT": lambda status: status[0] & 1,
        "GTO": lambda status: status[0] >> 3 & 1,
        "STA": lambda status: status[0] >> 4 & 3,
        "OBJ": lambda status: status[0] >> 6,
        "FLT": lambda status: status[2],
        "PRE": lambda status: status[3],
        "POS": lambda status: status[4],
        "COU": lambda status: status[5],
    }
    PLACES: Mapping[str, int] = {"POS": 3, "SPE": 4, "FOR": 5}

    def __init__(self, registers: Registers, host: str, port: int, now_s: Callable[[], float] = time.monotonic) -> None:
        self._registers, self._now_s, self.mute_until_s = registers, now_s, 0.0
        super().__init__(host, port)
        self.banner = f"gripper: URCap socket at {host}:{self.port}"

    def serve(self, client: socket.socket) -> None:
        """Answer until the client is gone."""
        with client.makefile("r", encoding="ascii", errors="replace") as lines:
            for line in lines:
                if self._registers.powered and self._now_s() >= self.mute_until_s:
                    client.sendall(self._answer(line.strip()).encode())

    def _answer(self, line: str) -> str:
        word, _, rest = line.partition(" ")
        if word == "GET" and rest in self.FIELDS:
            return f"{rest} {self.FIELDS[rest](self._registers.status())}"
        pairs = re.findall(r"([A-Z]{3}) (\d+)", rest)
        if word != "SET" or not pairs:
            return "?"
        command = bytearray(self._registers.command)
        for name, value in pairs:
            if name in self.PLACES:
                command[self.PLACES[name]] = min(int(value), 255)
            elif name in ("ACT", "GTO"):
                bit = 1 if name == "ACT" else 8
                command[0] = command[0] | bit if int(value) else command[0] & ~bit
        self._registers.write(0, bytes(command))
        return "ack"


def serve_modbus(cell: TwinCell, role: str) -> ModbusTwin:
    """The gripper of the twin at the port that the configuration names, with its faults."""
    settings, registers = cell.settings[role], _registers(cell)
    twin = ModbusTwin(registers, Path(settings["port"]), settings["node_id"])

    count = round(LOST_S * cell.slower / ANSWER_S)

    def spoil(what: str) -> Callable[[], None]:
        return lambda: setattr(twin, what, count)

    cell.offer("gripper_answers_lost", f"the gripper's answers are lost for {LOST_S:g} s", spoil("lose"))
    cell.offer("gripper_crc", f"for {LOST_S:g} s the gripper's answers have a wrong check sum", spoil("damage"))
    cell.offer("gripper_replugged", "the gripper's adapter comes back under another number", twin.replug)
    return twin


class CanTwin:
    """The gripper's node on the bus that the configuration names: the simulated cell has opened it.

    Attributes:
        banner: where it listens.
    """

    def __init__(self, interface: str, channel: str) -> None:
        self.banner = f"gripper: CAN node on the bus {interface} {channel}"

    def close(self) -> None:
        """The cell lets go of the bus."""


def serve_can(cell: TwinCell, role: str) -> CanTwin:
    """The gripper of the twin on a bus that other processes reach (socketcan, udp_multicast), with its faults."""
    settings, node = cell.settings[role], cell.sim.gripper_node
    cell.offer("gripper_bus_off", "the gripper's node falls silent on its bus", node.silence)
    cell.offer("gripper_bus_on", "the gripper's node is on its bus again", lambda: node.silence(False))
    return CanTwin(settings["interface"], settings["channel"])


def serve_urcap(cell: TwinCell, role: str) -> UrcapTwin:
    """The gripper of the twin behind the URCap's socket, with its faults."""
    settings = cell.settings[role]
    twin = UrcapTwin(_registers(cell), settings["host"], settings["port"], cell.now_s)

    def mute() -> None:
        twin.mute_until_s = cell.now_s() + LOST_S

    cell.offer("gripper_answers_lost", f"the URCap answers nothing for {LOST_S:g} s", mute)
    return twin


def _registers(cell: TwinCell) -> Registers:
    """The registers of the twin's gripper, whose power can be taken away."""
    node = cell.sim.gripper_node
    registers = Registers(node, cell.lock, node.gripper.stroke_m)
    cell.offer("gripper_power_off", "the gripper loses its power", lambda: registers.power(False))
    cell.offer("gripper_power_on", "the gripper has its power again", lambda: registers.power(True))
    return registers


def _opening_mm(count: int, stroke_mm: float) -> float:
    share = (CLOSED_COUNT - count) / (CLOSED_COUNT - OPEN_COUNT)
    return stroke_mm * min(max(share, 0.0), 1.0)


def _value(count: int, limits: tuple[float, float]) -> float:
    return limits[0] + count / 255 * (limits[1] - limits[0])
