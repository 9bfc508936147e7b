"""The twin of a Robotiq 2F-85: its register block over the simulated fingers, and two wires that reach it.

Modbus RTU on a pseudo terminal (functions 3, 4, 6, 16, 23), and the URCap's text socket.
"""

from __future__ import annotations

import os
import re
import select
import socket
import struct
import threading
import tty
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Protocol

from cell.errors import InputError
from sim.twin.cell import TwinCell

OPEN_COUNT, CLOSED_COUNT = 3, 228  # where the fingers end in the position register
STROKE_MM = 85.0
SPEEDS_MM_S, FORCES_N = (20.0, 150.0), (20.0, 235.0)  # of registers 0 and 255
COMMAND_REGISTER, STATUS_REGISTER = 0x03E8, 0x07D0
CONTACT_CLOSING, AT_POSITION = 2, 3  # gOBJ
LISTEN_S = 0.1  # between looks whether the twin ends
POLYNOMIAL, LONGEST = 0xA001, 256
READ, WRITE, WRITE_ONE, READ_WRITE = (3, 4), 16, 6, 23


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

    def __init__(self, fingers: Fingers, lock: Any) -> None:
        self._fingers, self._lock = fingers, lock
        self._command = bytearray(6)
        self.powered = True

    def write(self, at: int, data: bytes) -> None:
        """Set command bytes, and let the fingers follow them all."""
        self._command[at : at + len(data)] = data
        first, _, _, position, speed, force = self._command
        with self._lock:
            self._fingers.write({
                "rACT": first & 1, "rGTO": first >> 3 & 1, "rATR": first >> 4 & 1, "rARD": first >> 5 & 1,
                "rPR": _opening_mm(position),
                "rSP": _value(speed, SPEEDS_MM_S),
                "rFR": _value(force, FORCES_N),
            })  # fmt: skip

    def status(self) -> bytes:
        """As it is now."""
        with self._lock:
            told = self._fingers.registers()
        asked = self._command[3]
        position = round(CLOSED_COUNT + told["gPO"] / STROKE_MM * (OPEN_COUNT - CLOSED_COUNT))
        met = int(told["gOBJ"])
        if met == AT_POSITION and asked > position + 1:  # the fingers met each other before they were where they go
            met = CONTACT_CLOSING
        first = int(told["gACT"]) | int(told["gGTO"]) << 3 | int(told["gSTA"]) << 4 | met << 6
        return bytes((first, 0, int(told["gFLT"]), asked, position, min(255, round(100 * told["gCU"]))))

    def power(self, on: bool) -> None:
        """Take its power away, or give it back."""
        self.powered = on
        self._command = bytearray(6)
        if not on:
            self.write(0, bytes(self._command))


class ModbusTwin:
    """Node 9 at an adapter, whose name is a link to a pseudo terminal.

    Attributes:
        told: where it listens.
        lose, damage: so many answers from now on are lost, or have a wrong check sum.
    """

    def __init__(self, registers: Registers, port: Path, node_id: int = 9) -> None:
        self._registers, self._port, self._node_id = registers, port, node_id
        self.lose = self.damage = 0
        self.told = f"gripper: Modbus RTU, node {node_id}, at {port}"
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

    def _unplug(self) -> None:
        ends, self._ends = self._ends, (-1, -1)
        for end in ends:
            with suppress(OSError):
                os.close(end)

    def _serve(self) -> None:
        frame = b""
        while not self._ended.is_set():
            master = self._ends[0]
            try:
                ready, _, _ = select.select([master], [], [], LISTEN_S)
                frame = frame + os.read(master, LONGEST) if ready else b""
                if len(frame) >= 8 and crc(frame[:-2]) == frame[-2:]:
                    if answer := self._answer(frame[:-2]):
                        os.write(master, answer)
                    frame = b""
            except (OSError, ValueError):  # it is being replugged
                frame = b""
                self._ended.wait(LISTEN_S)

    def _answer(self, asked: bytes) -> bytes:
        if asked[0] != self._node_id or not self._registers.powered or self._lost():
            return b""
        function, body = asked[1], asked[2:]
        if function in READ:
            at, count = struct.unpack(">HH", body)
            told = self._read(at, count)
        elif function == WRITE:
            at, count, size = struct.unpack(">HHB", body[:5])
            self._write(at, body[5 : 5 + size])
            told = body[:4]
        elif function == WRITE_ONE:
            self._write(int.from_bytes(body[:2], "big"), body[2:])
            told = body
        elif function == READ_WRITE:
            at, count, to, _, size = struct.unpack(">HHHHB", body[:9])
            self._write(to, body[9 : 9 + size])
            told = self._read(at, count)
        else:
            return b""  # the gripper knows no exceptions
        answer = asked[:2] + told
        return answer + (bytes(2) if self._damaged() else crc(answer))

    def _lost(self) -> bool:
        self.lose -= (lost := self.lose > 0)
        return lost

    def _damaged(self) -> bool:
        self.damage -= (damaged := self.damage > 0)
        return damaged

    def _read(self, at: int, count: int) -> bytes:
        first = 2 * (at - STATUS_REGISTER)
        data = (self._registers.status() + bytes(LONGEST))[max(first, 0) :][: 2 * count]
        return bytes((len(data),)) + data

    def _write(self, at: int, data: bytes) -> None:
        if 0 <= (first := 2 * (at - COMMAND_REGISTER)) < 6:
            self._registers.write(first, data[: 6 - first])


class UrcapTwin:
    """The text socket of the URCap: SET is answered with ack, GET with the name and its value."""

    FIELDS: Mapping[str, Callable[[bytes], int]] = {
        "ACT": lambda told: told[0] & 1,
        "GTO": lambda told: told[0] >> 3 & 1,
        "STA": lambda told: told[0] >> 4 & 3,
        "OBJ": lambda told: told[0] >> 6,
        "FLT": lambda told: told[2],
        "PRE": lambda told: told[3],
        "POS": lambda told: told[4],
        "COU": lambda told: told[5],
    }
    PLACES: Mapping[str, int] = {"POS": 3, "SPE": 4, "FOR": 5}

    def __init__(self, registers: Registers, host: str, port: int) -> None:
        self._registers = registers
        try:
            self._listener = socket.create_server((host, port))
        except OSError as error:
            raise InputError(f"{host}:{port}: the twin cannot listen there: {error.strerror or error}") from None
        self.port = self._listener.getsockname()[1]
        self.told = f"gripper: URCap socket at {host}:{self.port}"
        self.mute = False
        self._listener.settimeout(LISTEN_S)
        self._ended = threading.Event()
        self._set = bytearray(6)
        self._threads = [threading.Thread(target=self._listen, name="urcap", daemon=True)]
        self._threads[0].start()

    def close(self) -> None:
        """Nobody answers any more."""
        self._ended.set()
        for thread in self._threads:
            thread.join()
        self._listener.close()

    def _listen(self) -> None:
        while not self._ended.is_set():
            with suppress(TimeoutError):
                taken, _ = self._listener.accept()
                taken.settimeout(LISTEN_S)
                self._threads.append(threading.Thread(target=self._serve, args=(taken,), daemon=True))
                self._threads[-1].start()

    def _serve(self, taken: socket.socket) -> None:
        waiting = b""
        with taken:
            while not self._ended.is_set():
                try:
                    data = taken.recv(LONGEST)
                except TimeoutError:
                    continue
                except OSError:
                    return
                if not data:
                    return
                *lines, waiting = (waiting + data).split(b"\n")
                for line in lines:
                    if self._registers.powered and not self.mute:
                        taken.sendall(self._answer(line.decode("ascii", "replace").strip()).encode())

    def _answer(self, line: str) -> str:
        word, _, rest = line.partition(" ")
        if word == "GET" and rest in self.FIELDS:
            return f"{rest} {self.FIELDS[rest](self._registers.status())}"
        pairs = re.findall(r"([A-Z]{3}) (\d+)", rest)
        if word != "SET" or not pairs:
            return "?"
        for name, value in pairs:
            self._take(name, min(int(value), 255))
        self._registers.write(0, bytes(self._set))
        return "ack"

    def _take(self, name: str, value: int) -> None:
        if name in self.PLACES:
            self._set[self.PLACES[name]] = value
        elif name in ("ACT", "GTO"):
            bit = 1 if name == "ACT" else 8
            self._set[0] = self._set[0] | bit if value else self._set[0] & ~bit


def crc(data: bytes) -> bytes:
    """Check sum of Modbus RTU (CRC-16, low byte first)."""
    value = 0xFFFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ (POLYNOMIAL if value & 1 else 0)
    return value.to_bytes(2, "little")


def serve_modbus(cell: TwinCell, role: str) -> ModbusTwin:
    """The gripper of the twin at the port that the configuration names, with its faults."""
    settings, registers = cell.settings[role], _registers(cell)
    twin = ModbusTwin(registers, Path(settings["port"]), settings["node_id"])

    def lose() -> None:
        twin.lose = 20

    def damage() -> None:
        twin.damage = 20

    cell.offer("gripper_answers_lost", "20 answers of the gripper are lost", lose)
    cell.offer("gripper_crc", "20 answers of the gripper have a wrong check sum", damage)
    cell.offer("gripper_replugged", "the gripper's adapter comes back under another number", twin.replug)
    return twin


def serve_urcap(cell: TwinCell, role: str) -> UrcapTwin:
    """The gripper of the twin behind the URCap's socket, with its faults."""
    settings = cell.settings[role]
    twin = UrcapTwin(_registers(cell), settings["host"], settings["port"])

    def mute() -> None:
        twin.mute = not twin.mute

    cell.offer("gripper_answers_lost", "the URCap stops answering, or begins again", mute)
    return twin


def _registers(cell: TwinCell) -> Registers:
    """The registers of the twin's gripper, whose power can be taken away."""
    registers = Registers(cell.sim.gripper_node, cell.lock)
    cell.offer("gripper_power_off", "the gripper loses its power", lambda: registers.power(False))
    cell.offer("gripper_power_on", "the gripper has its power again", lambda: registers.power(True))
    return registers


def _opening_mm(count: int) -> float:
    share = (CLOSED_COUNT - count) / (CLOSED_COUNT - OPEN_COUNT)
    return STROKE_MM * min(max(share, 0.0), 1.0)


def _value(count: int, limits: tuple[float, float]) -> float:
    return limits[0] + count / 255 * (limits[1] - limits[0])
