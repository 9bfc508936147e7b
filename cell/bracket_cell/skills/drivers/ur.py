"""An arm of Universal Robots: samples by a receiver of our own, set points by `ur-rtde` in a process of its own.

That process stands on the path by itself when nobody speaks to it. What takes seconds (unlocking, powering on, a new
program) is done by a thread beside the loop; until it is done, the arm tells the mode that it stopped with.
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from importlib.util import find_spec
from typing import Any

import numpy as np

from bracket_cell.remote.channel import Channel, Message
from bracket_cell.remote.child import Child
from bracket_cell.skills.drivers import ur_stream as said
from bracket_cell.skills.drivers.rtde_receiver import RtdeReceiver, Sample
from bracket_cell.skills.drivers.settings import UrSettings
from bracket_cell.skills.drivers.ur_dashboard import bring_back, stop_program
from bracket_cell.skills.drivers.ur_examined import BASE_TO_WORLD, refuse_another
from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.clock import Clock
from bracket_ground.interfaces.command import JointTrajectory
from bracket_ground.interfaces.observation import STALE_ARM_S, ArmMode, ArmState, JointSamples
from bracket_ground.interfaces.product import Product
from bracket_ground.interfaces.robot import RobotModel

if find_spec("rtde_control") is None:  # which the process that streams imports
    raise ModuleNotFoundError("no ur-rtde is installed", name="rtde_control")

SILENT_S = 0.1  # a process that sends nothing for this long sends no set points
OPENING_S, LEAVING_S = 10.0, 3.0
SETTLED_RAD_S, SETTLES_S = 0.01, 0.5  # an arm whose set points stand has come to rest when it is so slow, or then
PROJECTED_S, UNSURE_RAD = 0.02, 0.002  # how far time and joints may err where a sample's place on the path is told
MODES: dict[int, ArmMode] = {
    1: "normal", 2: "reduced", 3: "protective_stop", 4: "recovery", 5: "safeguard_stop",
    6: "emergency_stop", 7: "emergency_stop", 8: "violation", 9: "fault",
}  # fmt: skip
RUNNING, PLAYING = 7, 2  # robot mode, runtime state
POWER = {3: "it has no power", 4: "it has power and no brakes released", 5: "its brakes are on", 2: "it is booting"}
IN_USE = "in use"


@dataclass
class Stream:
    """A running process that streams, and what it told.

    Attributes:
        sent: newest set points of the path that was begun last, oldest first.
        paths: how many were begun.
        lost: why it streams no more; empty while it does.
        heard_s: time of the machine of the newest set point.
        begun: one was told.
    """

    child: Child
    channel: Channel[Any]
    sent: deque[said.Sent] = field(default_factory=lambda: deque(maxlen=512))
    paths: int = 0
    lost: str = ""
    heard_s: float = field(default_factory=time.monotonic)
    begun: bool = False

    def hear(self, slower: float) -> None:
        """Take what it told; notice when it is silent, stopped or gone."""
        if self.lost:
            return
        try:
            while (message := self.channel.taken()) is not None:
                if isinstance(message, said.Lost):
                    self.lost = message.reason
                    return
                if isinstance(message, said.Sent):
                    self.heard_s, self.begun = message.time_s, True
                    if message.path == self.paths:
                        self.sent.append(message)
        except EOFError:
            self.lost = f"the {self.child.name} died"
            return
        silent_s = (time.monotonic() - self.heard_s) / slower
        if silent_s > (SILENT_S if self.begun else 3 * SILENT_S):
            self.lost = f"the {self.child.name} sent no set point for {silent_s:.2f} s"

    def begin(self, trajectory: JointTrajectory, from_s: float = 0.0) -> None:
        """Let it follow a path; what it told of the one before says nothing about this one."""
        self.paths += 1
        self.sent.clear()
        self.say(said.Begin(trajectory, from_s))

    def say(self, message: Message) -> None:
        """Tell it something; a process that is gone shows in `hear`."""
        with suppress(EOFError, TimeoutError):
            self.channel.send(message, 0.01)

    def close(self, limit_s: float) -> None:
        """Let it stand on the path and leave."""
        self.say(said.Leave())
        self.child.code(limit_s)
        self.child.close()


class UrArm:
    """Implements `Arm`.

    Args:
        product: says how much a held part weighs at most.

    Raises:
        DeviceFault: the controller does not answer, is another arm's, or somebody must do something at the arm first.
    """

    def __init__(self, settings: UrSettings, clock: Clock, product: Product, robot: RobotModel) -> None:
        self._settings, self._clock = settings, clock
        self._slower: float = getattr(clock, "slower", 1.0)
        self._acceleration_rad_s2 = np.array(robot.acceleration_rad_s2)
        self._tcp = (0.0, 0.0, robot.tool.tcp_from_flange_m, 0.0, 0.0, 0.0)
        self._part_kg = max((part.mass_kg for part in product.parts.values()), default=0.0)
        self._carried = False
        self._stream: Stream | None = None
        self._path: JointTrajectory | None = None
        self._path_s: float | None = None  # where on it the arm was last seen
        self._stopped: tuple[ArmMode, str] | None = None  # until it is brought back
        self._letting_go = self._bringing = threading.Thread()
        self._share, self._upper = 1.0, settings.registers == "upper"
        self._last_s = -np.inf
        if robot.calibration is not None:
            refuse_another(settings, robot.calibration)
        self._receiver = RtdeReceiver(settings.host, clock, self._slower)
        try:
            self._refuse_stopped(self._receiver.newest)
            self._open()
        except DeviceFault:
            self._receiver.close()
            raise

    def state(self) -> ArmState:
        """Joints of the newest sample; where none comes it is old, and `reason` says why."""
        sample = self._receiver.newest
        mode, reason = self._mode(sample)
        if not reason and self._clock.now_s() - sample.time_s > STALE_ARM_S:
            reason = self._receiver.trouble or "no sample came"
        moving, path_s = self._followed(sample)
        positions, speeds = tuple(sample.positions_rad.tolist()), tuple(sample.velocities_rad_s.tolist())
        x, y, z = (BASE_TO_WORLD @ sample.force_n).tolist()
        return ArmState(sample.time_s, positions, speeds, moving, mode, path_s, reason, (x, y, z))

    def follow(self, trajectory: JointTrajectory) -> JointTrajectory:
        """Start now; raises DeviceFault while the arm takes no commands."""
        mode, reason = self._mode(self._receiver.newest)
        if mode not in ("normal", "reduced") or self._stream is None:
            raise DeviceFault("arm", reason or f"it is in the mode {mode}")
        self._path, self._path_s = trajectory, 0.0
        self._stream.begin(trajectory)
        return trajectory

    def pace(self, share: float) -> None:
        """Go on at this share of the speed, and no faster than the pendant's slider has it."""
        self._share = share
        if self._stream is not None:
            self._stream.say(said.Share(min(share, self._receiver.newest.speed_share)))

    def stop(self) -> None:
        """Stop on the path and give it up."""
        if self._stream is not None:
            self._stream.say(said.Stop())
        if self._stopped is not None:
            self._path = None

    def acknowledge(self) -> None:
        """Begin to bring an arm back that stopped, but for an open safeguard; its mode stays until that is done."""
        if self._stopped is not None and self._stopped[0] != "safeguard_stop":
            self._bring_back()

    def carry(self, held: bool) -> None:
        """A part is held, or is not any more: the controller is told what hangs on the flange."""
        if held != self._carried:
            self._carried = held
            if self._stream is not None:
                self._stream.say(self._payload())

    def samples(self) -> JointSamples | None:
        """Every sample since the last call; moments are what the controller reckons."""
        taken = [one for one in self._receiver.taken() if one.time_s > self._last_s]
        if not taken:
            return None
        self._last_s = taken[-1].time_s
        columns = (
            [getattr(one, name) for one in taken] for name in ("positions_rad", "velocities_rad_s", "moments_nm")
        )
        return JointSamples(np.array([one.time_s for one in taken]), *map(np.array, columns))

    def close(self) -> None:
        """The arm stands on its path, its program ends; harmless when repeated."""
        for thread in (self._letting_go, self._bringing):
            if thread.is_alive():
                thread.join(LEAVING_S * self._slower)
        if self._stream is not None:
            self._stream.close(LEAVING_S * self._slower)
            self._stream = None
        self._receiver.close()

    def _mode(self, sample: Sample) -> tuple[ArmMode, str]:
        """The mode as it is told, with why; an arm that stopped keeps its mode until it is brought back."""
        stopped = self._why_stopped(sample)
        if stopped is not None and (self._stopped is None or stopped[0] != self._stopped[0]):
            self._note(*stopped)
        if self._stopped is None:
            return MODES.get(sample.safety_mode, "fault"), ""
        if self._stopped[0] == "safeguard_stop" and sample.safety_mode in (1, 2):
            self._stopped = "safeguard_closed", "the safeguard is closed again"
        return self._stopped

    def _why_stopped(self, sample: Sample) -> tuple[ArmMode, str] | None:
        """What keeps the arm from moving, the gravest first; None where nothing new does."""
        safety = MODES.get(sample.safety_mode, "fault")
        if safety not in ("normal", "reduced"):
            return safety, f"the controller is in {safety.replace('_', ' ')}"
        if self._stopped is not None:
            return None
        if sample.robot_mode != RUNNING:
            return "not_controlled", POWER.get(sample.robot_mode, f"its robot mode is {sample.robot_mode}")
        if self._stream is not None:
            self._stream.hear(self._slower)
        lost = "no program runs" if self._stream is None else self._stream.lost
        if sample.runtime_state != PLAYING or lost:
            return "not_controlled", lost or "somebody stopped or paused its program"
        return None

    def _note(self, mode: ArmMode, reason: str) -> None:
        """The arm stopped: nothing may go on by itself, whoever presses play."""
        began, self._stopped = self._stopped is None, (mode, reason)
        if mode != "safeguard_stop":
            self._path = None
        if began:
            stream, self._stream = self._stream, None
            self._letting_go = threading.Thread(target=self._let_go, args=(stream,), daemon=True)
            self._letting_go.start()

    def _let_go(self, stream: Stream | None) -> None:
        stop_program(self._settings.host, self._slower)
        if stream is not None:
            stream.close(1.0)

    def _bring_back(self) -> None:
        """Beside the loop, once at a time."""
        if not self._bringing.is_alive():
            self._bringing = threading.Thread(target=self._brought_back, name="bring back", daemon=True)
            self._bringing.start()

    def _brought_back(self) -> None:
        assert self._stopped is not None
        mode = self._stopped[0]
        if self._letting_go.is_alive():
            self._letting_go.join()
        try:
            bring_back(self._settings.host, self._slower)
            self._open()
        except DeviceFault as error:
            self._stopped = mode, error.reason
            return
        self._stopped = None

    def _open(self) -> None:
        """A process that streams from where the arm stands, and goes on with a path that it was held on.

        Raises:
            DeviceFault: the controller takes no program.
        """
        settings, rate_hz = self._settings, 500.0 if self._receiver.version[0] >= 5 else 125.0
        stream = self._opened(rate_hz)
        if IN_USE in stream.lost and settings.registers == "auto" and not self._upper:
            self._upper = True
            stream = self._opened(rate_hz)
        if stream.lost:
            raise DeviceFault("arm", f"the controller takes no program: {stream.lost}")
        sample = self._receiver.newest
        stream.say(said.Start(sample.positions_rad, self._acceleration_rad_s2))
        path, path_s = self._path, self._path_s
        if path is not None and path_s is not None:
            stream.begin(path, path_s)
        stream.heard_s = time.monotonic()
        self._stream = stream

    def _opened(self, rate_hz: float) -> Stream:
        settings = self._settings
        serve = partial(
            said.serve,
            *(settings.host, rate_hz, self._slower, settings.lookahead_s, settings.gain, self._upper, self._tcp),
            self._payload(),
        )
        child = Child("process that streams set points", serve, outlives=True)
        stream = Stream(child, Channel(child.socket, said.FromStream))
        try:
            first = stream.channel.receive(OPENING_S * self._slower)
            stream.lost = first.reason if isinstance(first, said.Lost) else ""
        except (EOFError, TimeoutError) as error:
            stream.lost = str(error) or f"it is not ready after {OPENING_S:g} s"
        if stream.lost:
            child.close()
        return stream

    def _payload(self) -> said.Payload:
        held_kg = self._part_kg if self._carried else 0.0
        return said.Payload(self._settings.payload_kg + held_kg, self._settings.payload_centre_m)

    def _refuse_stopped(self, sample: Sample) -> None:
        """Raise DeviceFault where somebody must do something at the arm before a run."""
        mode = MODES.get(sample.safety_mode, "fault")
        if mode not in ("normal", "reduced"):
            raise DeviceFault("arm", f"it is in {mode.replace('_', ' ')}: clear it at the pendant, then run again")
        if sample.robot_mode != RUNNING:
            why = POWER.get(sample.robot_mode, f"its robot mode is {sample.robot_mode}")
            raise DeviceFault("arm", f"{why}: switch it on at the pendant, then run again")

    def _followed(self, sample: Sample) -> tuple[bool, float | None]:
        """Whether the arm is on its way, and where on its path it was when the sample was taken.

        The joints trail the set points by a time that belongs to the controller, and grows where the pendant's slider
        goes down. The place is the nearest one on the path between where the arm was seen before and the set point.
        """
        path = self._path
        if path is None:
            return False, None
        if self._stopped is not None:  # it comes to rest without set points
            at_s = self._path_s or 0.0
            self._path_s = nearest_s(path, (at_s, at_s), at_s, sample)
            return True, self._path_s
        stream = self._stream
        if stream is None or not stream.sent:
            return True, self._path_s
        now_s, machine_s = self._clock.now_s(), time.monotonic()
        times_s = np.array([now_s - (machine_s - one.time_s) / self._slower for one in stream.sent])
        rates = max(self._receiver.newest.speed_share, 0.05)
        lag_s = self._settings.lag_s / rates
        newest = stream.sent[-1]
        ended = newest.path_s is None
        places_s = [one.path_s for one in stream.sent if one.path_s is not None]
        at_s = float(np.interp(sample.time_s - lag_s, times_s[: len(places_s)], places_s)) if places_s else 0.0
        done_s = next((t for t, one in zip(times_s, stream.sent, strict=True) if not one.moving), np.inf)
        settled = float(np.abs(sample.velocities_rad_s).max()) < SETTLED_RAD_S and sample.time_s > done_s + lag_s
        moving = newest.moving or not (settled or sample.time_s > done_s + SETTLES_S)
        if ended and not moving:
            self._path = self._path_s = None
            return False, None
        farthest_s = path.duration_s if ended else max(places_s)
        self._path_s = nearest_s(path, (self._path_s or 0.0, farthest_s), at_s, sample)
        return moving, self._path_s


def nearest_s(path: JointTrajectory, between_s: tuple[float, float], about_s: float, sample: Sample) -> float:
    """The place on the path where the arm is, by joints and time: where the path hardly moves, joints tell little.

    Args:
        between_s: where it may be, give or take 20 ms.
        about_s: where time has it.
    """
    first_s, last_s = np.clip([between_s[0] - PROJECTED_S, between_s[1] + PROJECTED_S], 0.0, path.duration_s)
    about_s = min(max(about_s, first_s), last_s)
    marks_s = np.linspace(first_s, last_s, math.ceil((last_s - first_s) / PROJECTED_S) + 1)
    off = np.linalg.norm(path.along(marks_s) - sample.positions_rad, axis=1) / UNSURE_RAD
    near_s = float(marks_s[np.hypot(off, (marks_s - about_s) / PROJECTED_S).argmin()])
    before, here, after = path.along(near_s + np.array([-0.5, 0.0, 0.5]) * PROJECTED_S)
    speed = (after - before) / PROJECTED_S / UNSURE_RAD
    ahead = speed @ (sample.positions_rad - here) / UNSURE_RAD + (about_s - near_s) / PROJECTED_S**2
    return float(np.clip(near_s + ahead / (speed @ speed + PROJECTED_S**-2), first_s, last_s))
