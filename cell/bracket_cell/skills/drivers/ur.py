"""An arm of Universal Robots: samples by RTDE, set points by `ur-rtde`, brought back by its dashboard."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib.util import find_spec

import numpy as np

from bracket_cell.skills.drivers.rtde import RtdeConnection
from bracket_cell.skills.drivers.samples import Sample
from bracket_cell.skills.drivers.settings import UrSettings
from bracket_cell.skills.drivers.stream import Link
from bracket_cell.skills.drivers.streaming import StreamingArm
from bracket_cell.skills.drivers.ur_dashboard import bring_back, stop_program
from bracket_cell.skills.drivers.ur_examined import refuse_another, world_from_base
from bracket_cell.skills.drivers.ur_safety import safety_of
from bracket_ground.interfaces.clock import Clock
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.product import Product
from bracket_ground.interfaces.robot import RobotModel

if find_spec("rtde_control") is None:  # which the process that streams imports
    raise ModuleNotFoundError("no ur-rtde is installed", name="rtde_control")

OUTPUTS = (
    *("timestamp", "actual_q", "actual_qd", "target_moment", "robot_mode", "safety_mode", "runtime_state"),
    *("speed_scaling", "target_speed_fraction", "actual_TCP_force"),
)
ANSWER_S = 2.0
RUNNING, PLAYING = 7, 2  # robot mode, runtime state
POWER = {3: "it has no power", 4: "it has power and no brakes released", 5: "its brakes are on", 2: "it is booting"}
IN_USE = "in use"
E_SERIES, RATES_HZ = 5, (125.0, 500.0)  # major version from which it is one
WATCHDOG_HZ = 10.0  # the controller's program ends where nothing comes for longer than this
BRAKING_RAD_S2 = 10.0


class UrSamples(RtdeConnection):
    """A connection that tells samples; raises as `RtdeConnection`.

    Attributes:
        period_s: of the controller.

    Args:
        turn: (3, 3) of the controller's base in the world.
    """

    def __init__(self, host: str, limit_s: float, turn: Array) -> None:
        super().__init__(host, OUTPUTS, None, limit_s)
        self.period_s, self._turn = 1.0 / RATES_HZ[self.version[0] >= E_SERIES], turn

    def receive(self) -> Sample:
        """The next sample; raises OSError."""
        values = self.values()
        joints = np.array(values[1:19]).reshape(3, 6)
        robot, safety, runtime = map(int, values[19:22])
        scaling, fraction = (min(max(value, 0.0), 1.0) for value in values[22:24])
        named = safety_of(safety)
        mode, reason = named.mode, named.reason
        if not reason and robot != RUNNING:
            mode, reason = "not_controlled", POWER.get(robot, f"its robot mode is {robot}")
        force_n = self._turn @ np.array(values[24:27])
        at, speed, moment = joints
        return Sample(values[0], at, speed, moment, mode, reason, runtime == PLAYING, scaling * fraction, force_n)


class UrLink:
    """The genuine client, in the process that streams; implements `Link`.

    Raises:
        RuntimeError: as it raised it.
    """

    def __init__(self, settings: UrSettings, period_s: float, upper: bool, tcp_m: float, mass_kg: float) -> None:
        from rtde_control import RTDEControlInterface as Control

        flags = Control.FLAG_UPLOAD_SCRIPT | (Control.FLAG_UPPER_RANGE_REGISTERS if upper else 0)
        self._control = Control(settings.host, 1 / period_s, flags)
        self._servo = (0.0, 0.0, period_s, settings.lookahead_s, settings.gain)
        self._control.setTcp([0.0, 0.0, tcp_m, 0.0, 0.0, 0.0])
        self.load(mass_kg, settings.payload_centre_m)
        self._control.setWatchdog(WATCHDOG_HZ)

    def send(self, joints_rad: Array) -> None:
        """The set point of this period."""
        if not self._control.servoJ(joints_rad.tolist(), *self._servo):
            raise RuntimeError("its program does not run any more")
        self._refuse_gone()

    def idle(self) -> None:
        """Nothing to follow yet."""
        self._control.kickWatchdog()
        self._refuse_gone()

    def load(self, mass_kg: float, centre_m: tuple[float, float, float]) -> None:
        """What hangs on the flange."""
        self._control.setPayload(mass_kg, list(centre_m))

    def close(self) -> None:
        """Stop what is left of the motion, end the program."""
        self._control.servoStop(BRAKING_RAD_S2)
        self._control.stopScript()
        self._control.disconnect()

    def _refuse_gone(self) -> None:
        if not self._control.isConnected():  # else the client goes on to say that it sends
            raise RuntimeError("it hung up")


class UrArm(StreamingArm):
    """Implements `Arm`.

    Args:
        product: says how much a held part weighs at most.

    Raises:
        DeviceFault: the controller does not answer, is another arm's, or somebody must do something at the arm first.
    """

    def __init__(self, settings: UrSettings, clock: Clock, product: Product, robot: RobotModel) -> None:
        self._settings, self._tcp_m = settings, robot.gripper.tcp_from_flange_m
        self._turn = world_from_base(robot)[:3, :3]
        self._part_kg = max((part.mass_kg for part in product.parts.values()), default=0.0)
        self._carried, self._upper = False, settings.registers == "upper"
        if robot.calibration is not None:
            refuse_another(settings, robot.calibration)
        super().__init__(clock, robot, settings.host, settings.lag_s)

    def connect(self) -> UrSamples:
        """By RTDE."""
        return UrSamples(self._settings.host, ANSWER_S * self.slower, self._turn)

    def link(self) -> Callable[[], Link]:
        """By the genuine client."""
        return partial(UrLink, self._settings, self.period_s, self._upper, self._tcp_m, self._mass_kg)

    def another_way(self, refused: str) -> bool:
        """By the upper registers, where somebody else owns the lower ones."""
        free = IN_USE in refused and self._settings.registers == "auto" and not self._upper
        self._upper = self._upper or free
        return free

    def carry(self, held: bool) -> None:
        """A part is held, or is not any more: the controller is told what hangs on the flange."""
        if held != self._carried:
            self._carried = held
            self.load(self._mass_kg, self._settings.payload_centre_m)

    def let_go(self) -> None:
        """End its program, whoever presses play."""
        stop_program(self._settings.host, self.slower)

    def bring_back(self) -> None:
        """Unlock, power on, release the brakes."""
        bring_back(self._settings.host, self.slower)

    @property
    def _mass_kg(self) -> float:
        return self._settings.payload_kg + self._part_kg * self._carried
