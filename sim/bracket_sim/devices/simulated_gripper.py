"""The gripper as a CAN node: its registers on one side of the bus, simulated fingers or a cup on the other.

Updated once in each control period by simulated time; it never waits and reads no other clock.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from enum import IntEnum
from typing import cast

import can
import cantools.database
from cantools.database.can import Database

from bracket_ground.errors import DeviceFault
from bracket_ground.files.files import shipped
from bracket_ground.interfaces.can_bus import open_bus
from bracket_ground.interfaces.command import GripperCommand
from bracket_ground.interfaces.gripper import Gripper, scaled
from bracket_ground.interfaces.observation import GripperState, ObjectStatus
from bracket_ground.interfaces.observation import NodeState as NodeName
from bracket_sim.scene.grippers import GRIP_DAMPING_NS_M, GRIP_STIFFNESS_N_M
from bracket_sim.scene.world import World

AT_POSITION_M = 0.0012
STILL_M_S = 0.003
SLIPPING_M_S = 0.015  # a grip is lost when the fingers move this fast again
STILL_PERIODS = 4
PRESSING_SHARE = 0.9  # of the requested force, where contact begins
IDLE_CURRENT_A = 0.03
FULL_CURRENT_A = 1.0


class Jaw:
    """A set point that runs towards a target opening, at most `force / stiffness` ahead of the fingers."""

    def __init__(self, world: World) -> None:
        self._world, fingers = world, world.robot.gripper.fingers
        assert fingers is not None
        self._stroke_m, self._most_n = fingers.stroke_m, fingers.force_n[1]
        self._set_point_m = self._target_m = self._last_m = world.opening_m
        self._speed_m_s, self._force_n = 0.1, self._most_n
        self._still_periods = 0
        self._gripping = False

    def go(self, opening_m: float, speed_m_s: float, force_n: float) -> None:
        """Start a motion."""
        self._target_m = min(max(opening_m, 0.0), self._stroke_m)
        self._speed_m_s, self._force_n = speed_m_s, force_n
        self._still_periods, self._gripping = 0, False

    def stop(self) -> None:
        """Stop where the fingers are; what they hold they go on holding."""
        if not self._gripping:
            self._target_m = self._set_point_m = self._world.opening_m

    def update(self, dt_s: float) -> None:
        """Move the set point by one control period."""
        opening = self._world.opening_m
        speed = abs(opening - self._last_m) / dt_s
        self._last_m = opening
        # The servo's damping eats force while the fingers move; only the rest presses.
        lead = (self._force_n + GRIP_DAMPING_NS_M * speed) / GRIP_STIFFNESS_N_M
        step = self._speed_m_s * dt_s
        moved = self._set_point_m + min(max(self._target_m - self._set_point_m, -step), step)
        self._set_point_m = min(max(moved, opening - lead), opening + lead)
        self._world.drive_opening(self._set_point_m)
        self._still_periods = self._still_periods + 1 if speed < STILL_M_S else 0
        pressing = self.force_n >= PRESSING_SHARE * self._force_n and self._still_periods >= STILL_PERIODS
        self._gripping = pressing or (self._gripping and speed < SLIPPING_M_S)

    @property
    def opening_m(self) -> float:
        """Distance between the pads."""
        return self._world.opening_m

    @property
    def force_n(self) -> float:
        """What the motor presses with."""
        return GRIP_STIFFNESS_N_M * abs(self._world.opening_m - self._set_point_m)

    @property
    def status(self) -> ObjectStatus:
        """Register gOBJ."""
        if abs(self._world.opening_m - self._target_m) < AT_POSITION_M:
            return ObjectStatus.AT_POSITION
        if not self._gripping:
            return ObjectStatus.MOVING
        closing = self._target_m < self._world.opening_m
        return ObjectStatus.CONTACT_CLOSING if closing else ObjectStatus.CONTACT_OPENING

    @property
    def current_a(self) -> float:
        """Motor current."""
        return IDLE_CURRENT_A + (FULL_CURRENT_A - IDLE_CURRENT_A) * min(1.0, self.force_n / self._most_n)


class Nothing:
    """No gripper: it is at once where it was told to be."""

    opening_m, status, current_a = 0.0, ObjectStatus.AT_POSITION, 0.0

    def go(self, opening_m: float, speed_m_s: float, force_n: float) -> None:  # noqa: ARG002 - of fingers
        """Be there."""
        self.opening_m = opening_m

    def stop(self) -> None:
        """Nothing moves."""

    def update(self, dt_s: float) -> None:
        """Nothing moves."""


class Suction:
    """A cup on its ejector, or a magnet: its pull builds up where the lip seals or steel lies on the pole, else hardly.

    Attributes:
        share: of the most pull.
    """

    def __init__(self, world: World) -> None:
        self._world, does, cup = world, world.robot.gripper.switched, world.robot.gripper.cup
        assert does is not None
        self._does, self._stroke_m, self.share = does, does.stroke_m, 0.0
        self._held_share = MAGNET_SHARE if cup is None else cup.held_kpa / cup.vacuum_kpa
        self._on, self._since_s = False, math.inf

    def go(self, opening_m: float, speed_m_s: float, force_n: float) -> None:  # noqa: ARG002 - of fingers
        """Switch it on for an opening of 0, else off."""
        on = opening_m < self._stroke_m / 2
        self._since_s = self._since_s if on and self._on else 0.0
        self._on = on

    def stop(self) -> None:
        """What it holds it goes on holding."""

    def update(self, dt_s: float) -> None:
        """Let one control period pass."""
        most = (1.0 if self._world.sealed else LEAKS_SHARE) if self._on else 0.0
        self.share += (most - self.share) * min(1.0, dt_s / BUILDS_S)
        self._since_s += dt_s
        self._world.suck(max(self.share, LEAST_SUCTION) if self._on else 0.0)

    @property
    def opening_m(self) -> float:
        """0 while it sucks."""
        return 0.0 if self._on else self._stroke_m

    @property
    def status(self) -> ObjectStatus:
        """Register gOBJ: by the pull, and by the time that it takes."""
        if not self._on:
            return ObjectStatus.AT_POSITION if self.share < OFF_SHARE else ObjectStatus.MOVING
        if self.share >= self._held_share:
            return ObjectStatus.CONTACT_CLOSING
        return ObjectStatus.MOVING if self._since_s < self._does.builds_s else ObjectStatus.AT_POSITION

    @property
    def current_a(self) -> float:
        """Of the valve."""
        return IDLE_CURRENT_A


BUILDS_S, OFF_SHARE = 0.06, 0.08  # time constant of a small cup's volume [s]; below it nothing is held any more
LEAKS_SHARE, LEAST_SUCTION = 0.15, 0.02  # of the most pull: with an open lip, and before it has built up
MAGNET_SHARE = 0.6  # of a magnet's most pull, from which on its device tells that it holds
DATABASE = shipped("bracket_cell.config", "gripper.dbc")
STATUS_PERIOD_S = 0.020
HEARTBEAT_PERIOD_S = 0.100
QUIET_LIMIT_S = 1.0
HOMING_M_S, HOMING_N = 0.15, 40.0
RELEASE_M_S, RELEASE_N = 0.02, 20.0
CURRENT_STEP_A = 0.01  # of gCU
MAJOR_FAULT = 0x08
EMERGENCY_BASE = 0xFF00  # CANopen: device specific
SLACK_S = 1e-6


class Fault(IntEnum):
    """Values of gFLT that this node reaches by itself."""

    HEALTHY = 0x00
    DELAYED_UNTIL_ACTIVATED = 0x05
    NOT_ACTIVATED = 0x07
    NO_COMMUNICATION = 0x09
    RELEASING = 0x0B
    RELEASED = 0x0F


class Activation(IntEnum):
    """Register gSTA."""

    RESET = 0
    ACTIVATING = 1
    ACTIVE = 3


class NodeState(IntEnum):
    """State in the heartbeat."""

    BOOT_UP = 0x00
    OPERATIONAL = 0x05
    PRE_OPERATIONAL = 0x7F


class GripperNode:
    """Answers GripperCommand frames; sends status, heartbeat and emergency.

    Args:
        interface, channel: python-can bus to open, for example "virtual" and "cell".
    """

    def __init__(self, world: World, interface: str, channel: str) -> None:
        gripper = world.robot.gripper
        database = cantools.database.load_string(scaled(DATABASE.read_text("cp1252"), gripper), "dbc")
        assert isinstance(database, Database)
        self._database = database
        self._command_id = database.get_message_by_name("GripperCommand").frame_id
        self._bus = open_bus(interface, channel)
        self.gripper, self._stroke_m = gripper, gripper.stroke_m
        self._jaw = Jaw(world) if gripper.fingers else Suction(world) if gripper.switched else Nothing()
        self._request: Mapping[str, float] = _request(gripper)
        self._driven: Mapping[str, float] | None = None  # the request that the fingers follow
        self._activation = Activation.RESET
        self._homing_m: list[float] = []  # openings that activation still has to reach
        self._release: Fault | None = None
        self._injected = self._announced = 0
        self._heard_s = 0.0
        self._booted = self._silent = False
        self._encoded: dict[str, tuple[dict[str, float], int, bytes]] = {}  # the last frame of each message
        self._statuses = self._heartbeats = 0
        self._direct = False  # a master has spoken to the registers themselves: it is there as long as the program
        self._time_s = 0.0

    def inject_fault(self, fault: int) -> None:
        """Break the gripper for a test: gFLT shows `fault` until the master resets rACT."""
        self._injected = fault

    def silence(self, silent: bool = True) -> None:
        """Unplug the node's transmitter for a test, or plug it in again."""
        self._silent = silent

    def close(self) -> None:
        """Let go of the bus."""
        self._bus.shutdown()

    def write(self, request: Mapping[str, float]) -> Mapping[str, float]:
        """Set the command's registers without the bus; returns them in their steps."""
        self._direct = True
        kept = self._decode(self._database.get_message_by_name("GripperCommand").encode(request))
        self._accept(kept)
        return kept

    def registers(self) -> Mapping[str, float]:
        """The status as the bus would tell it; gOBJ says moving until a command is taken up."""
        status = self._status(self._fault(self._time_s))
        if self._request["rGTO"] and self._driven != self._request:
            status["gOBJ"] = ObjectStatus.MOVING
        return status | {"time_s": self._time_s}

    @property
    def vacuum_kpa(self) -> float | None:
        """Of a cup, how far the pressure is below the air's."""
        share, cup = getattr(self._jaw, "share", 0.0), self.gripper.cup
        return None if cup is None else share * cup.vacuum_kpa

    def update(self, time_s: float, dt_s: float) -> None:
        """Read commands, drive the fingers, send what is due."""
        self._time_s = time_s
        while (message := self._bus.recv(timeout=0)) is not None:
            # A frame of another length is not the command, whatever its identifier says.
            if message.arbitration_id == self._command_id and message.dlc == 8 and not message.is_error_frame:
                self._heard_s = time_s
                self._accept(self._decode(bytes(message.data)))
        fault = self._fault(time_s)
        self._drive(fault)
        self._jaw.update(dt_s)
        self._report(time_s, fault)

    def _decode(self, data: bytes) -> Mapping[str, float]:
        values = self._database.decode_message(self._command_id, data, decode_choices=False)
        return cast(dict[str, float], values)  # numbers, as choices are not decoded

    def _accept(self, request: Mapping[str, float]) -> None:
        self._request = request
        if not request["rACT"]:
            self._activation, self._injected, self._release = Activation.RESET, 0, None
        elif self._activation is Activation.RESET:
            self._activation = Activation.ACTIVATING
            self._homing_m = [self._stroke_m, 0.0]
            self._jaw.go(self._homing_m[0], HOMING_M_S, HOMING_N)
        if request["rATR"] and self._activation is Activation.ACTIVE and self._release is None:
            self._release = Fault.RELEASING
            self._jaw.go(self._stroke_m if request["rARD"] else 0.0, RELEASE_M_S, RELEASE_N)

    def _fault(self, time_s: float) -> int:
        """Register gFLT, the gravest first."""
        if self._injected:
            return self._injected
        if self._release is not None:
            return self._release
        quiet = not self._direct and time_s - self._heard_s > QUIET_LIMIT_S
        if quiet and self._activation is not Activation.RESET:
            return Fault.NO_COMMUNICATION
        if self._request["rGTO"] and self._activation is not Activation.ACTIVE:
            activating = self._activation is Activation.ACTIVATING
            return Fault.DELAYED_UNTIL_ACTIVATED if activating else Fault.NOT_ACTIVATED
        return Fault.HEALTHY

    def _drive(self, fault: int) -> None:
        """Let the fingers follow activation, release or the request, and stop them otherwise."""
        done = self._jaw.status is not ObjectStatus.MOVING
        if self._release is not None:
            self._driven = None
            if done:
                self._release = Fault.RELEASED
        elif self._activation is Activation.ACTIVATING and not self._injected:
            if done:
                self._home_on()
        elif self._activation is Activation.ACTIVE and self._request["rGTO"] and fault == Fault.HEALTHY:
            if self._driven != self._request:
                self._driven = self._request
                self._jaw.go(self._request["rPR"] / 1000, self._request["rSP"] / 1000, self._request["rFR"])
        else:
            self._driven = None
            self._jaw.stop()

    def _home_on(self) -> None:
        self._homing_m.pop(0)
        if self._homing_m:
            self._jaw.go(self._homing_m[0], HOMING_M_S, HOMING_N)
        else:
            self._activation = Activation.ACTIVE

    def _report(self, time_s: float, fault: int) -> None:
        if fault != self._announced:
            self._announced = fault
            code = EMERGENCY_BASE + fault if fault else 0
            self._send("GripperEmergency", {"ErrorCode": code, "ErrorRegister": int(fault > 0), "FaultStatus": fault})
        if time_s >= self._statuses * STATUS_PERIOD_S - SLACK_S:
            self._statuses += 1
            self._send("GripperStatus", self._status(fault))
        if time_s >= self._heartbeats * HEARTBEAT_PERIOD_S - SLACK_S:
            self._heartbeats += 1
            self._send("GripperHeartbeat", {"NodeState": self._node_state()})

    def _status(self, fault: int) -> dict[str, float]:
        opening_mm = min(max(self._jaw.opening_m, 0.0), self._stroke_m) * 1000
        return {
            "gACT": self._request["rACT"],
            "gGTO": self._request["rGTO"],
            "gSTA": self._activation,
            "gOBJ": self._jaw.status,
            "gFLT": fault,
            "gPR": self._request["rPR"],
            "gPO": _in_steps(opening_mm, self._stroke_m * 1000 / 255),
            "gCU": _in_steps(self._jaw.current_a, CURRENT_STEP_A),
        }

    def _node_state(self) -> NodeState:
        if not self._booted:
            self._booted = True
            return NodeState.BOOT_UP
        return NodeState.OPERATIONAL if self._activation is Activation.ACTIVE else NodeState.PRE_OPERATIONAL

    def _send(self, name: str, values: dict[str, float]) -> None:
        if self._silent:
            return
        last_values, frame_id, data = self._encoded.get(name, ({}, 0, b""))
        if values != last_values:  # most frames repeat the one before, and encoding takes longer than sending
            message = self._database.get_message_by_name(name)
            frame_id, data = message.frame_id, message.encode(values)
            self._encoded[name] = values, frame_id, data
        self._bus.send(can.Message(arbitration_id=frame_id, data=data, is_extended_id=False))


class SimGripper:
    """Implements `Gripper` at the registers of the simulated node, without a bus between."""

    def __init__(self, node: GripperNode) -> None:
        self._node = node
        self._request = _request(node.gripper)

    def state(self) -> GripperState:
        """As the registers are now; raises DeviceFault on a major fault."""
        regs = self._node.registers()
        fault = int(regs["gFLT"])
        if fault >= MAJOR_FAULT:
            raise DeviceFault("gripper", f"fault 0x{fault:02X}")
        active = regs["gSTA"] == Activation.ACTIVE
        node_state: NodeName = "operational" if active else "pre_operational"
        status, opening_m = ObjectStatus(int(regs["gOBJ"])), regs["gPO"] / 1000
        kpa = self._node.vacuum_kpa
        return GripperState(regs["time_s"], active, status, opening_m, regs["gCU"], fault, node_state, vacuum_kpa=kpa)

    def activate(self) -> None:
        """Begin activation, a full open and close."""
        self._write(rACT=1.0, rGTO=0.0)

    def command(self, command: GripperCommand) -> GripperCommand:
        """Start a motion; values beyond the registers' range are cut to it."""
        does = self._node.gripper.does
        (slow, fast), (least, most) = does.speed_m_s, does.force_n
        opening_mm = min(max(command.opening_m, 0.0), does.stroke_m) * 1000
        speed_mm_s = min(max(command.speed_m_s, slow), fast) * 1000
        force_n = min(max(command.force_n, least), most)
        sent = self._write(rGTO=1.0, rPR=opening_mm, rSP=speed_mm_s, rFR=force_n)
        return GripperCommand(sent["rPR"] / 1000, sent["rSP"] / 1000, sent["rFR"])

    def hold(self) -> None:
        """The fingers stop and keep their grip."""
        self._write(rGTO=0.0)

    def close(self) -> None:
        """The node is the world's."""

    def _write(self, **registers: float) -> Mapping[str, float]:
        self._request |= registers
        return self._node.write(self._request)


def _in_steps(value: float, step: float) -> float:
    """What a register can tell; a finger that trembles less than a step tells the same again."""
    return round(value / step) * step


def _request(gripper: Gripper) -> dict[str, float]:
    """What the registers hold before the first command."""
    does = gripper.does
    rest = {"rPR": does.stroke_m * 1000, "rSP": does.speed_m_s[0] * 1000, "rFR": does.force_n[0]}
    return {"rACT": 0.0, "rGTO": 0.0, "rATR": 0.0, "rARD": 0.0, **rest}
