"""The controller of the twin's arm: modes, registers, and the program that obeys `ur-rtde`."""

from __future__ import annotations

import re
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from bracket_ground.interfaces.pose import Array
from bracket_sim.twin.cell import TwinCell
from bracket_sim.twin.ur_model import Model, model_of

OFFSET = re.compile(r"reg_offset_int\s*=\s*(?:#[^\n]*\n)?\s*(\d+)")  # ur-rtde writes it behind a comment
REDUCED_S = 0.5  # within which an arm that is faster must keep to the limits of reduced mode (user manual)
UNLOCK_S = 5.0  # after a protective stop, before it can be unlocked
BOOT_S, RELEASE_S = 1.0, 0.5  # until the arm idles once power is on, and until its brakes are off
BRAKING_RAD_S2 = 10.0  # of a stop that the controller makes by itself
PAYLOAD_OFF_KG, PAYLOAD_SPEED_RAD_S, PAYLOAD_PERIODS = 1.0, 1.0, 12  # a wrong payload is felt at speed
POLYSCOPE_X = 10  # major version from which a controller has no dashboard
REALTIME = {6, 9, 10, 11, *range(24, 28), 38, 58, *range(66, 72)}  # commands that nothing waits for
ACTUAL_TOOL_KG = 0.93
ANALOG = [f"{kind}{number}" for kind in ("standard_analog_input", "standard_analog_output", "tool_analog_input")
          for number in (0, 1)]  # fmt: skip


class Runtime(IntEnum):
    """State of the program."""

    STOPPED = 1
    PLAYING = 2
    PAUSED = 4


class RobotMode(IntEnum):
    """What the arm's power does."""

    POWER_OFF = 3
    BOOTING = 2
    IDLE = 5
    RUNNING = 7


class Safety(IntEnum):
    """The safety controller's mode."""

    NORMAL = 1
    REDUCED = 2
    PROTECTIVE = 3
    SAFEGUARD = 5
    EMERGENCY = 7


@dataclass
class Registers:
    """What programs and clients leave for one another."""

    ints_in: list[int] = field(default_factory=lambda: [0] * 48)
    doubles_in: list[float] = field(default_factory=lambda: [0.0] * 48)
    ints_out: list[int] = field(default_factory=lambda: [0] * 48)
    doubles_out: list[float] = field(default_factory=lambda: [0.0] * 48)
    bits_in: list[bool] = field(default_factory=lambda: [False] * 128)
    bits_out: list[bool] = field(default_factory=lambda: [False] * 128)


class Controller:
    """Runs once a control period under the cell's lock.

    Attributes:
        fieldbus: somebody else owns the lower registers.
        remote: remote control is on; without it a newer controller takes no program from outside.
        slider: of the pendant, 0 to 1.
        renewed: when input register 0 of the program was last written, for its watchdog.
        boots: how often the controller was started.
        inputs, outputs: bits of the digital terminals: standard, configurable from bit 8 on, tool from bit 16 on.
        analog: values of the analogue inputs and outputs, in [V] or [A].
        volts: bits of the analogue outputs that are voltages.
        limits: of the safety configuration.
    """

    def __init__(self, cell: TwinCell) -> None:
        self.cell, self.arm = cell, cell.arm
        self.model: Model = model_of(cell.robot)
        self.limits = cell.sim.world.robot.safety
        self.registers = Registers()
        self.payload_kg, self.payload_cog_m, self.extra_kg = ACTUAL_TOOL_KG, (0.0, 0.0, 0.05), 0.0
        self.tcp: Array = np.array([0.0, 0.0, 0.156, 0.0, 0.0, 0.0])
        self.robot_mode, self.safety, self.runtime = RobotMode.RUNNING, Safety.NORMAL, Runtime.STOPPED
        self.fieldbus, self.remote, self.slider = False, True, 1.0
        self.renewed: dict[int, float] = {}
        self.inputs = self.outputs = 0
        self.analog = dict.fromkeys(ANALOG, 0.0)
        self.boots, self.volts, self._epoch_s = 0, 0, 0.0
        self._reduced_s: float | None = None  # since when
        self._program: int | None = None  # its offset of registers
        self._watchdog_s: float | None = None
        self._busy = False
        self._stopped_s = self._power_s = self._wrong_periods = 0.0
        self.turned_rad: Array = np.zeros(6)  # what the joints tell beside where they are
        cell.each_period(self._cycle)

    @property
    def now_s(self) -> float:
        """The controller's own time: it begins anew when it is started again."""
        return self.cell.now_s() - self._epoch_s

    @property
    def old(self) -> bool:
        """Before remote control was a mode: CB3."""
        return self.model.version[0] < 5

    @property
    def safety_mode(self) -> Safety:
        """As it is told."""
        reduced = self._reduced_s is not None and self.safety is Safety.NORMAL
        return Safety.REDUCED if reduced else self.safety

    @property
    def takes_programs(self) -> bool:
        """Whether a program from outside is begun."""
        able = self.robot_mode is RobotMode.RUNNING and self.safety is Safety.NORMAL
        return able and self.remote

    def upload(self, text: str) -> None:
        """A program came from outside."""
        offset = OFFSET.search(text)
        if not self.takes_programs:
            return
        self.stop_program()
        if "def rtde_control" in text:
            self._program, self._busy = int(offset[1]) if offset else 0, False
            self._watchdog_s = None
            self.runtime = Runtime.PLAYING
            self.registers.ints_out[self._program] = 1
            self.cell.person_comes()

    def stop_program(self) -> None:
        """The program ends; the arm slows down."""
        self._program, self.runtime = None, Runtime.STOPPED
        self.arm.stop(BRAKING_RAD_S2)

    def pause(self) -> None:
        """The program waits, the arm slows down; what it was told stands."""
        if self.runtime is Runtime.PLAYING:
            self.runtime = Runtime.PAUSED
            self.arm.stop(BRAKING_RAD_S2)

    def play(self) -> bool:
        """A program that waits goes on; returns whether one did."""
        waits = self.runtime is Runtime.PAUSED and self.safety is Safety.NORMAL
        if waits and self.robot_mode is RobotMode.RUNNING:
            self.runtime = Runtime.PLAYING
        return self.runtime is Runtime.PLAYING

    def protective_stop(self) -> None:
        """The arm stops by itself; the program is left paused."""
        self._halt(Safety.PROTECTIVE)

    def safeguard(self, closed: bool) -> None:
        """Somebody opens or closes the safeguard; a program that it paused goes on."""
        if not closed:
            self._halt(Safety.SAFEGUARD)
        elif self.safety is Safety.SAFEGUARD:
            self.safety = Safety.NORMAL
            self.play()

    def emergency(self, pressed: bool) -> None:
        """The button is pressed: power goes, the program ends. Released, the arm is without power."""
        if pressed:
            self._halt(Safety.EMERGENCY)
            self.runtime, self._program = Runtime.STOPPED, None
            self.robot_mode = RobotMode.POWER_OFF
        elif self.safety is Safety.EMERGENCY:
            self.safety = Safety.NORMAL

    def _halt(self, why: Safety) -> None:
        self.safety, self._stopped_s = why, self.now_s
        if self.runtime is Runtime.PLAYING:
            self.runtime = Runtime.PAUSED
        self.arm.stop(BRAKING_RAD_S2)

    def reduce(self, on: bool) -> None:
        """Reduced mode begins or ends: a trigger plane or an input."""
        self._reduced_s = self.now_s if on else None

    def unlock(self) -> bool:
        """Somebody says that a protective stop may end; refused for the first seconds."""
        if self.safety is Safety.PROTECTIVE and self.now_s - self._stopped_s < UNLOCK_S:
            return False
        if self.safety is Safety.PROTECTIVE:
            self.safety = Safety.NORMAL
        return True

    def power_on(self) -> None:
        """The arm boots."""
        if self.robot_mode is RobotMode.POWER_OFF and self.safety is Safety.NORMAL:
            self.robot_mode, self._power_s = RobotMode.BOOTING, self.now_s

    def power_off(self) -> None:
        """The program ends, and power goes."""
        self.stop_program()
        self.robot_mode = RobotMode.POWER_OFF

    def release_brakes(self) -> None:
        """The arm may move."""
        if self.robot_mode is RobotMode.IDLE and self.safety is Safety.NORMAL:
            self.robot_mode = RobotMode.RUNNING

    def restart(self) -> None:
        """Somebody switches the controller off and on again: its time begins anew, the arm is without power."""
        self.stop_program()
        self._epoch_s, self.boots = self.cell.now_s(), self.boots + 1
        self.registers, self.safety, self.robot_mode = Registers(), Safety.NORMAL, RobotMode.POWER_OFF

    def mend(self) -> None:
        """Everything that may be wrong is mended."""
        self.stop_program()
        self.safety, self.robot_mode, self.model = Safety.NORMAL, RobotMode.RUNNING, model_of(self.cell.robot)
        self.fieldbus, self.remote, self.slider, self.extra_kg = False, True, 1.0, 0.0
        self.turned_rad, self.arm.held_back, self._reduced_s = np.zeros(6), "", None

    def written(self, register: int) -> None:
        """A client wrote this integer register."""
        self.renewed[register] = self.now_s

    def _cycle(self, _: float) -> None:
        if self.robot_mode is RobotMode.BOOTING and self.now_s - self._power_s > BOOT_S:
            self.robot_mode = RobotMode.IDLE
        self.arm.scale = self.slider
        self._watch_safety()
        if self._program is not None and self.runtime is Runtime.PLAYING:
            self._step(self._program)

    def _watch_safety(self) -> None:
        reduced = self._reduced_s is not None and self.now_s - self._reduced_s > REDUCED_S
        self.arm.limits = self.limits.reduced if reduced else self.limits.normal
        off_kg = abs(self.payload_kg - ACTUAL_TOOL_KG - self.extra_kg)
        fast = float(np.abs(self.arm.driven_rad_s).max()) > PAYLOAD_SPEED_RAD_S
        self._wrong_periods = self._wrong_periods + 1 if off_kg > PAYLOAD_OFF_KG and fast else 0
        if self.safety is Safety.NORMAL and (self.arm.held_back or self._wrong_periods > PAYLOAD_PERIODS):
            held = bool(self.arm.held_back)
            self.protective_stop()
            if held:
                self.arm.freeze()

    def _step(self, offset: int) -> None:
        """One cycle of the program that `ur-rtde` uploads."""
        ints = self.registers.ints_out
        command = self.registers.ints_in[offset]
        if self._watchdog_s is not None and self.now_s - self.renewed.get(offset, -1.0) > self._watchdog_s:
            self.stop_program()
            return
        if command in REALTIME:
            self._realtime(command, offset)
        elif self._busy:
            if not self.arm.moving:
                self._busy, ints[offset] = False, 2
        elif ints[offset] == 2:
            if command == 0:
                ints[offset] = 1
        elif command not in (0, 99):
            self._busy = self._begin(command, offset)
            ints[offset] = 1 if self._busy else 2

    def _realtime(self, command: int, offset: int) -> None:
        values = self.registers.doubles_in[offset:]
        if command == 11:
            self.arm.servo(np.array(values[:6]), values[9], values[10])
        elif command == 9:
            self.arm.speed(np.array(values[:6]), values[6])

    def _begin(self, command: int, offset: int) -> bool:
        """Begin an ordinary command; returns whether it takes longer."""
        values, waits = self.registers.doubles_in[offset:], self.registers.ints_in[offset + 1] == 0
        match command:
            case 1:
                self.arm.move([(np.array(values[:6]), values[6], values[7])])
                return waits
            case 15 | 16 | 33 | 34:
                self.arm.stop(values[0])
                return waits or command in (15, 16)
            case 17:
                self.payload_kg, self.payload_cog_m = values[0], (values[1], values[2], values[3])
            case 29:
                self.tcp = np.array(values[:6])
            case 31:
                self.protective_stop()
            case 35:
                self._watchdog_s = 1 / values[0] if values[0] > 0 else None
                self.written(offset)
            case 47:
                self.registers.ints_out[offset + 1] = int(not self.arm.moving)
            case 255:
                self.stop_program()
        return False


class UrWires:
    """All ports of the controller."""

    def __init__(self, cell: TwinCell, role: str) -> None:
        from bracket_sim.twin.rtde import RtdeServer
        from bracket_sim.twin.ur_dashboard import Dashboard
        from bracket_sim.twin.ur_faults import offer_faults
        from bracket_sim.twin.ur_ports import PrimaryPort

        host = str(cell.settings[role].get("host", "127.0.0.1"))
        self.controller = Controller(cell)
        with ExitStack() as stack:
            rtde = stack.enter_context(closing(RtdeServer(self.controller, host)))
            if self.controller.model.version[0] < POLYSCOPE_X:
                stack.enter_context(closing(Dashboard(self.controller, host)))
            for port in (30001, 30002, 30003, 30011):
                stack.enter_context(closing(PrimaryPort(self.controller, host, port)))
            offer_faults(cell, self.controller, rtde)
            self._stack = stack.pop_all()
        version = ".".join(map(str, self.controller.model.version[:3]))
        self.banner = (
            f"{role}: {host}, {self.controller.model.name} {version}: "
            f"RTDE 30004 at {self.controller.model.rate_hz} Hz, "
            "dashboard 29999, programs 30001 to 30003, state and calibration 30001, 30002, 30011"
        )

    def close(self) -> None:
        """Close all ports."""
        self._stack.close()


def serve_ur(cell: TwinCell, role: str) -> UrWires:
    """Serve the controller of an arm; raises InputError where a port is taken."""
    return UrWires(cell, role)
