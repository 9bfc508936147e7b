"""RTDE, protocol version 2, as a controller serves it: recipes of outputs and inputs, one owner for each input.

Source: Universal Robots, "Real-Time Data Exchange (RTDE) guide". A package is its size (u16, with these three bytes),
its type (u8) and what belongs to the type, all big endian.
"""

from __future__ import annotations

import re
import socket
import struct
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np

from bracket_ground.interfaces.pose import Array
from bracket_sim.twin.controller import ANALOG, Controller, RobotMode, Runtime, Safety
from bracket_sim.twin.sockets import Port

PORT = 30004
MOST_HELD = 1 << 20
FORMS = {
    "BOOL": "?", "UINT8": "B", "UINT32": "I", "UINT64": "Q", "INT32": "i", "DOUBLE": "d",
    "VECTOR3D": "3d", "VECTOR6D": "6d", "VECTOR6INT32": "6i", "VECTOR6UINT32": "6I",
}  # fmt: skip
SIXES = (
    "target_current", "actual_current", "joint_control_output", "joint_temperatures", "actual_joint_voltage",
    "ft_raw_wrench", "actual_current_window", "payload_inertia",
)  # fmt: skip
DOUBLES = (
    "actual_execution_time", "actual_main_voltage", "actual_robot_voltage", "actual_robot_current",
    "tool_output_current", "tool_temperature", "io_current",
    "euromap67_24V_voltage", "euromap67_24V_current", "joint_position_deviation_ratio", "collision_detection_ratio",
)  # fmt: skip
WORDS = {  # integers that stay as they are
    "euromap67_input_bits": 0, "euromap67_output_bits": 0, "tool_mode": 255,
    "tool_output_mode": 0, "tool_digital_output0_mode": 0, "tool_digital_output1_mode": 0, "script_control_line": 0,
    "time_scale_source": 0, "tool_analog_input_types": 0,
}  # fmt: skip
BYTES = ("tool_output_mode", "tool_digital_output0_mode", "tool_digital_output1_mode")
INPUTS = {
    "speed_slider_mask": "UINT32", "speed_slider_fraction": "DOUBLE", "standard_digital_output_mask": "UINT8",
    "standard_digital_output": "UINT8", "configurable_digital_output_mask": "UINT8",
    "configurable_digital_output": "UINT8", "tool_digital_output_mask": "UINT8", "tool_digital_output": "UINT8",
    "standard_analog_output_mask": "UINT8", "standard_analog_output_type": "UINT8",
    "standard_analog_output_0": "DOUBLE", "standard_analog_output_1": "DOUBLE",
    "input_bit_registers0_to_31": "UINT32", "input_bit_registers32_to_63": "UINT32",
    "external_force_torque": "VECTOR6D",
}  # fmt: skip
REGISTER = re.compile(r"(input|output)_(int|double|bit)_register_(\d+)\Z")
KINDS = {"int": "INT32", "double": "DOUBLE", "bit": "BOOL"}
SAFETY_BITS = {Safety.NORMAL: 0, Safety.REDUCED: 1, Safety.PROTECTIVE: 2, Safety.SAFEGUARD: 4, Safety.EMERGENCY: 6}
REGISTERS = {"int": 48, "double": 48, "bit": 128}
TERMINALS = {"standard_digital_output": 0, "configurable_digital_output": 8, "tool_digital_output": 16}
JOINT_MODES = {RobotMode.POWER_OFF: 239, RobotMode.BOOTING: 247, RobotMode.IDLE: 255, RobotMode.RUNNING: 253}
ANALOG_OUT = re.compile(r"standard_analog_output_([01])\Z")
BITS_IN = re.compile(r"input_bit_registers(0|32)_to_\d+\Z")
IN_BASE = np.array([-1.0, -1.0, 1.0] * 2)  # the controller's base frame is turned by half a turn against the world
Value = float | Sequence[float] | Array
Read = Callable[[Controller], Value]


def _robot_bits(of: Controller) -> int:
    powered = of.robot_mode in (RobotMode.IDLE, RobotMode.RUNNING)
    return int(powered) | int(of.runtime is Runtime.PLAYING) << 1


def _safety_bits(of: Controller) -> int:
    stopped = of.safety is not Safety.NORMAL
    emergency = of.safety is Safety.EMERGENCY
    return 1 << SAFETY_BITS[of.safety_mode] | int(emergency) << 7 | int(stopped) << 10


def _target_speed(of: Controller) -> Value:
    """Of the TCP, as the set points go: its place and its turn (6,) in a second."""
    seen, step_s = of.arm.measured, 1e-4
    before, after = (
        of.model.tool_pose(seen.targets_rad + at_s * seen.target_speeds_rad_s, of.tcp) for at_s in (0, step_s)
    )
    turn = cv2.Rodrigues(cv2.Rodrigues(after[3:])[0] @ cv2.Rodrigues(before[3:])[0].T)[0].ravel()
    speed: Array = np.concatenate([after[:3] - before[:3], turn]) / step_s
    return speed


def _bits(attribute: str, first: int) -> Read:
    """32 bit registers as one number."""

    def read(of: Controller) -> Value:
        bits: Sequence[bool] = getattr(of.registers, attribute)[first : first + 32]
        return sum(1 << number for number, bit in enumerate(bits) if bit)

    return read


OUTPUTS: Mapping[str, tuple[str, Read]] = {
    "timestamp": ("DOUBLE", lambda of: of.arm.measured.time_s - of.cell.now_s() + of.now_s),
    "actual_q": ("VECTOR6D", lambda of: of.arm.measured.positions_rad + of.turned_rad),
    "actual_qd": ("VECTOR6D", lambda of: of.arm.measured.velocities_rad_s),
    "target_q": ("VECTOR6D", lambda of: of.arm.measured.targets_rad + of.turned_rad),
    "target_qd": ("VECTOR6D", lambda of: of.arm.measured.target_speeds_rad_s),
    "target_moment": ("VECTOR6D", lambda of: of.arm.measured.moments_nm),
    "actual_TCP_pose": ("VECTOR6D", lambda of: of.model.tool_pose(of.arm.measured.positions_rad, of.tcp)),
    "target_TCP_pose": ("VECTOR6D", lambda of: of.model.tool_pose(of.arm.measured.targets_rad, of.tcp)),
    "actual_TCP_force": ("VECTOR6D", lambda of: (*(of.arm.measured.force_n * IN_BASE[:3]), 0.0, 0.0, 0.0)),
    "robot_mode": ("INT32", lambda of: of.robot_mode),
    "safety_mode": ("INT32", lambda of: of.safety_mode),
    "safety_status": ("INT32", lambda of: of.safety_mode),
    "runtime_state": ("UINT32", lambda of: of.runtime),
    "robot_status_bits": ("UINT32", _robot_bits),
    "safety_status_bits": ("UINT32", _safety_bits),
    "speed_scaling": ("DOUBLE", lambda _: 1.0),
    "target_speed_fraction": ("DOUBLE", lambda of: of.slider),
    "payload": ("DOUBLE", lambda of: of.payload_kg),
    "payload_cog": ("VECTOR3D", lambda of: of.payload_cog_m),
    "tcp_offset": ("VECTOR6D", lambda of: of.tcp),
    **{six: ("VECTOR6D", lambda _: (0.0,) * 6) for six in SIXES},
    **{double: ("DOUBLE", lambda _: 0.0) for double in DOUBLES},
    "joint_mode": ("VECTOR6INT32", lambda of: (JOINT_MODES[of.robot_mode],) * 6),
    "actual_current_as_torque": ("VECTOR6D", lambda of: of.arm.measured.moments_nm),
    "target_TCP_speed": ("VECTOR6D", _target_speed),
    "analog_io_types": ("UINT32", lambda of: of.volts << 2),
    "actual_tool_accelerometer": ("VECTOR3D", lambda _: (0.0,) * 3),
    "actual_digital_input_bits": ("UINT64", lambda of: of.inputs),
    "actual_digital_output_bits": ("UINT64", lambda of: of.outputs),
    "tool_output_voltage": ("INT32", lambda _: 0),
    "target_qdd": ("VECTOR6D", lambda of: of.arm.gain_rad_s2),
    "actual_TCP_speed": ("VECTOR6D", lambda of: of.arm.measured.tool_m_s * IN_BASE),
    "actual_momentum": ("DOUBLE", lambda of: of.arm.measured.momentum_kg_m_s),
    "elbow_position": ("VECTOR3D", lambda of: of.arm.measured.elbow_m * IN_BASE[:3]),
    "elbow_velocity": ("VECTOR3D", lambda of: of.arm.measured.elbow_m_s * IN_BASE[:3]),
    "tcp_force_scalar": ("DOUBLE", lambda of: float(np.linalg.norm(of.arm.measured.force_n))),
    **{
        name: ("UINT8" if name in BYTES else "UINT32", lambda _, value=value: value)  # type: ignore[misc]
        for name, value in WORDS.items()
    },
    **{name: ("DOUBLE", lambda of, name=name: of.analog[name]) for name in ANALOG},  # type: ignore[misc]
    **{
        f"{way}_bit_registers{first}_to_{first + 31}": ("UINT32", _bits(attribute, first))
        for way, attribute in (("input", "bits_in"), ("output", "bits_out"))
        for first in (0, 32)
    },
}


def output_of(name: str) -> tuple[str, Read] | None:
    """Type of an output, and what reads it; None for one that there is not."""
    if name in OUTPUTS:
        return OUTPUTS[name]
    found = REGISTER.match(name)
    if found is None or int(found[3]) >= REGISTERS[found[2]]:
        return None
    number, attribute = int(found[3]), f"{found[2]}s_{'out' if found[1] == 'output' else 'in'}"

    def read(of: Controller) -> Value:
        value: float = getattr(of.registers, attribute)[number]
        return value

    return KINDS[found[2]], read


@dataclass(eq=False)
class Client:
    """One connection: its recipes, and whether it takes data."""

    socket: socket.socket
    outputs: struct.Struct | None = None
    reads: list[Read] = field(default_factory=list)
    every: int = 1
    started: bool = False
    inputs: list[tuple[struct.Struct, list[tuple[str, str]]]] = field(default_factory=list)
    protocol: int = 1
    held: deque[bytes] = field(default_factory=deque)


class RtdeServer(Port):
    """Serves RTDE clients; `late_until_s` and `silent_until_s` hold packages back for trials (world's time)."""

    def __init__(self, controller: Controller, host: str) -> None:
        self._of = controller
        self._known: dict[socket.socket, Client] = {}
        self._owners: dict[str, Client] = {}
        self._cycles = 0
        self.late_until_s = self.silent_until_s = 0.0
        super().__init__(host, PORT)
        controller.cell.each_period(self._publish)

    def serve(self, client: socket.socket) -> None:
        """Answer one client, and take what it sends."""
        known = self._known[client] = Client(client)
        try:
            while True:
                size, kind = struct.unpack(">HB", _exactly(client, 3))
                self._package(known, chr(kind), _exactly(client, size - 3))
        finally:
            del self._known[client]
            self._owners = {name: owner for name, owner in self._owners.items() if owner is not known}

    def _package(self, client: Client, kind: str, body: bytes) -> None:
        if kind == "U":
            self._take(client, body)
            return
        if kind == "V":
            (client.protocol,) = struct.unpack(">H", body)
            answer = struct.pack(">B", client.protocol in (1, 2))
        elif kind == "v":
            answer = struct.pack(">4I", *self._of.model.version)
        elif kind == "O":
            answer = self._output_recipe(client, body)
        elif kind == "I":
            answer = self._input_recipe(client, body.decode())
        elif kind in "SP":
            client.started = kind == "S" and client.outputs is not None
            answer = struct.pack(">?", client.started or kind == "P")
        else:
            return
        client.socket.sendall(_package(kind, answer))

    def _output_recipe(self, client: Client, body: bytes) -> bytes:
        rate_hz, names = (struct.unpack(">d", body[:8])[0], body[8:]) if client.protocol == 2 else (125.0, body)
        found = [output_of(name) for name in names.decode().split(",") if name]
        types = ",".join("NOT_FOUND" if output is None else output[0] for output in found)
        known = [output for output in found if output is not None]
        whole = 0 < len(known) == len(found)  # one that is not there cannot be started
        client.outputs = struct.Struct(">" + "".join(FORMS[kind] for kind, _ in known)) if whole else None
        client.reads = [read for _, read in known]
        client.every = max(1, round(self._of.model.rate_hz / max(rate_hz, 1.0)))
        return (b"\1" if client.protocol == 2 else b"") + types.encode()

    def _input_recipe(self, client: Client, names: str) -> bytes:
        wanted = [name for name in names.split(",") if name]
        types = [self._input_type(client, name) for name in wanted]
        if all(type_ in FORMS for type_ in types):
            self._owners.update(dict.fromkeys(wanted, client))
            form = struct.Struct(">" + "".join(FORMS[type_] for type_ in types))
            client.inputs.append((form, list(zip(wanted, types, strict=True))))
            return bytes([len(client.inputs)]) + ",".join(types).encode()
        return b"\0" + ",".join(types).encode()

    def _input_type(self, client: Client, name: str) -> str:
        found = REGISTER.match(name)
        if found is not None and found[1] == "input" and int(found[3]) < REGISTERS[found[2]]:
            kind = KINDS[found[2]]
        elif name in INPUTS:
            kind = INPUTS[name]
        else:
            return "NOT_FOUND"
        foreign = self._of.fieldbus and found is not None and int(found[3]) < 24
        return "IN_USE" if foreign or self._owners.get(name, client) is not client else kind

    def _take(self, client: Client, body: bytes) -> None:
        """Registers are written at once, as one client may not see half of another's."""
        form, names = client.inputs[body[0] - 1]
        values = list(form.unpack(body[1:]))
        sent = dict[str, float]()
        for name, kind in names:
            sent[name], *_ = (values.pop(0) for _ in range(6 if kind == "VECTOR6D" else 1))
        with self._of.cell.lock:
            for name, value in sent.items():
                if (found := REGISTER.match(name)) is not None:
                    self._write(found[2], int(found[3]), value)
                else:
                    self._obey(name, value, sent)

    def _write(self, kind: str, number: int, value: float) -> None:
        registers = self._of.registers
        if kind == "int":
            registers.ints_in[number] = int(value)
            self._of.written(number)
        elif kind == "double":
            registers.doubles_in[number] = float(value)
        else:
            registers.bits_in[number] = bool(value)

    def _obey(self, name: str, value: float, sent: Mapping[str, float]) -> None:
        """Slider, terminals and bits: what their masks name, as the guide has it."""
        of, mask = self._of, int(sent.get(f"{name}_mask", 0))
        if name == "speed_slider_fraction" and sent.get("speed_slider_mask"):
            of.slider = min(max(float(value), 0.0), 1.0)
        elif (first := TERMINALS.get(name)) is not None:
            of.outputs = of.outputs & ~(mask << first) | (int(value) & mask) << first
        elif (bits := BITS_IN.match(name)) is not None:
            first = int(bits[1])
            of.registers.bits_in[first : first + 32] = [bool(int(value) >> number & 1) for number in range(32)]
        elif (output := ANALOG_OUT.match(name)) is not None:
            self._set_analog(int(output[1]), float(value), sent)

    def _set_analog(self, number: int, share: float, sent: Mapping[str, float]) -> None:
        """An output of 0 to 10 V, or of 4 to 20 mA."""
        of, bit = self._of, 1 << number
        if int(sent.get("standard_analog_output_mask", 0)) & bit:
            volts = bool(int(sent.get("standard_analog_output_type", 0)) & bit)
            of.volts = of.volts | bit if volts else of.volts & ~bit
            of.analog[f"standard_analog_output{number}"] = 10.0 * share if volts else 0.004 + 0.016 * share

    def _publish(self, now_s: float) -> None:
        self._cycles += 1
        if now_s < self.silent_until_s:
            return
        for client in list(self._known.values()):
            if not client.started or client.outputs is None or self._cycles % client.every:
                continue
            values: list[float] = []
            for read in client.reads:
                value = read(self._of)
                values += [value] if isinstance(value, int | float) else list(value)
            recipe = b"\1" if client.protocol == 2 else b""
            client.held.append(_package("U", recipe + client.outputs.pack(*values)))
            if now_s >= self.late_until_s:
                self._send(client)

    def _send(self, client: Client) -> None:
        data = b"".join(client.held)
        client.held.clear()
        try:
            data = data[client.socket.send(data, socket.MSG_DONTWAIT) :]
        except BlockingIOError:
            pass
        except OSError:
            client.started = False
        if len(data) > MOST_HELD:  # it does not read
            client.started = False
        elif data:
            client.held.append(data)


def _package(kind: str, body: bytes) -> bytes:
    return struct.pack(">HB", len(body) + 3, ord(kind)) + body


def _exactly(client: socket.socket, count: int) -> bytes:
    data = b""
    while len(data) < count:
        part = client.recv(count - len(data))
        if not part:
            raise EOFError
        data += part
    return data
