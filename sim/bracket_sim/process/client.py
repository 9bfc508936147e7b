"""The devices of a cell that lives in another process."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, NoReturn, TypeVar

import numpy as np

from bracket_cell.remote.channel import Channel, Failure
from bracket_cell.remote.detecting import Bench, Tray
from bracket_ground.errors import DeviceFault, InputError, LatchedFault
from bracket_ground.interfaces.clock import Clock
from bracket_ground.interfaces.command import Display, GripperCommand, JointTrajectory
from bracket_ground.interfaces.devices import Devices, TruthEvent
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.observation import ArmState, GripperState, JointSamples
from bracket_ground.interfaces.operator import OperatorOrder
from bracket_ground.interfaces.perception import BenchView, PartsView
from bracket_sim.process import messages as said
from bracket_sim.process.buses import CarriedBuses

Value = TypeVar("Value")
Reply = TypeVar("Reply")
LIMIT_S: Mapping[said.Pace, float] = {"real": 0.2, "fast": 60.0}  # in which a world must answer
WELCOME_S = 60.0


class RemoteCell:
    """A connection to a world, with its devices.

    Attributes:
        devices: as in the world's own process.

    Args:
        connection: to the world.
        name: of the world's process, for faults.
        buses: this process's ends of the virtual CAN buses.
        glance: called while the world is waited for; raises DeviceFault where it cannot answer.
        closed: called once it was left.

    Raises:
        InputError: the world does not accept such a controller.
        CellError: as `glance` raised it.
    """

    def __init__(
        self,
        connection: socket.socket,
        name: str,
        pace: said.Pace,
        cell: Mapping[str, str],
        buses: CarriedBuses,
        glance: Callable[[], None] = lambda: None,
        closed: Callable[[], None] = lambda: None,
    ) -> None:
        self._name, self._buses, self._closed, self._limit_s = name, buses, closed, LIMIT_S[pace]
        self._glance = glance
        self._lock = threading.RLock()
        self._fault: DeviceFault | None = None
        newcomer: Channel[Any] = Channel(connection, said.ToNewcomer)
        welcome = self._welcomed(newcomer, said.Hello(pace, dict(cell)))
        self._channel: Channel[Any] = newcomer.hearing(said.ToController)
        self._frames: dict[str, Frame] = {}
        self._pressed: list[OperatorOrder] = []
        self._truth: list[TruthEvent] = []
        self._samples: list[JointSamples] = []
        self._take(welcome.snapshot)
        self.clock: Clock = _LockStep(self) if pace == "fast" else _Wall(self, welcome.epoch_s)
        self.devices = Devices(
            clock=self.clock,
            arm=_Arm(self),
            gripper=_Gripper(self),
            overhead=_Camera(self, "overhead"),
            wrist=_Camera(self, "wrist"),
            panel=_Panel(self),
            report=lambda: next(iter(self._judged(said.Report())), {}),
            close=self.close,
            truth=lambda: _emptied(self._truth),
            pressed=lambda: _emptied(self._pressed),
            finished=lambda: self._judged(said.Finished()),
            host=_Host(self) if welcome.detects and pace == "fast" else None,
            lost_s=lambda: self.snapshot.lost_s,
            gone=self._is_gone,
            upset=lambda name: self.order(said.Upset(name)),
        )

    @property
    def fault(self) -> DeviceFault | None:
        """Why the world is gone; None as long as it is there."""
        return self._fault

    def order(self, order: said.Order) -> None:
        """Let something be done, in the order of the calls."""
        with self._lock:
            self._send(order)

    def call(self, call: said.Call, reply: type[Reply]) -> Reply:
        """Let something be done, and wait for what it returns; raises what it raised."""
        with self._lock:
            self.flush()
            self._send(call)
            answer = self._receive()
        if isinstance(answer, Failure):
            raise answer.error(self._name)
        assert isinstance(answer, reply)
        return answer

    def flush(self) -> None:
        """What was sent on the CAN buses goes to the world; nothing happens where that is gone."""
        with suppress(DeviceFault):
            if frames := self._buses.take():
                self.order(said.Can(frames))

    def renew(self, until_s: float | None = None) -> None:
        """Ask how things are; in lock-step after the world has advanced.

        Where the world is gone, its devices say so.
        """
        with suppress(DeviceFault):
            self._take(self.call(said.Advance(until_s), said.Snapshot))

    def frame(self, camera: str) -> Frame | None:
        """Newest frame of a camera; raises what the camera raises."""
        self._refuse(camera)
        return self._frames.get(camera)

    def arm_state(self) -> ArmState:
        """As the world told last; raises what the arm raised."""
        self._refuse("arm")
        assert self.snapshot.arm is not None
        return self.snapshot.arm

    def gripper_state(self) -> GripperState:
        """As the world told last; raises what the gripper raised."""
        self._refuse("gripper")
        assert self.snapshot.gripper is not None
        return self.snapshot.gripper

    def samples(self) -> JointSamples | None:
        """What the arm measured since the last call."""
        self._refuse()
        taken = _emptied(self._samples)
        if len(taken) <= 1:
            return taken[0] if taken else None
        columns = ("times_s", "positions_rad", "velocities_rad_s", "efforts_nm")
        return JointSamples(
            *(np.concatenate([getattr(joint_samples, name) for joint_samples in taken]) for name in columns)
        )

    def close(self) -> None:
        """Leave the world; harmless when repeated."""
        with self._lock:
            self._channel.close()
            self._buses.close()
            self._fault = self._fault or DeviceFault(self._name, "it was left")
        self._closed()

    def _welcomed(self, newcomer: Channel[Any], hello: said.Hello) -> said.Welcome:
        until_s, answer = time.monotonic() + WELCOME_S, None
        try:
            newcomer.send(hello, 1.0)
            while answer is None and time.monotonic() < until_s:
                with suppress(TimeoutError):
                    answer = newcomer.receive(0.5)
                    break
                self._glance()
        except (EOFError, TimeoutError) as error:
            self._glance()
            answer = said.Refused(str(error) or "it does not listen")
        if isinstance(answer, said.Welcome):
            return answer
        newcomer.close()
        if isinstance(answer, Failure):
            raise answer.error(self._name)
        reason = answer.reason if isinstance(answer, said.Refused) else f"it is not ready after {WELCOME_S:g} s"
        raise InputError(f"{self._name}: the world takes no controller: {reason}")

    def _is_gone(self) -> bool:
        if self._fault is None:
            try:
                self._glance()
            except DeviceFault as fault:
                self._fault = fault
        return self._fault is not None

    def _take(self, snapshot: said.Snapshot) -> None:
        self.snapshot = snapshot
        self._frames.update({frame.camera: frame for frame in snapshot.frames})
        self._pressed += snapshot.pressed
        self._truth += snapshot.truth
        if snapshot.samples is not None:
            self._samples.append(snapshot.samples)
        self._buses.put(snapshot.can)

    def _judged(self, question: said.Report | said.Finished) -> list[dict[str, object]]:
        """What the world says; nothing where it is gone."""
        try:
            return list(self.call(question, said.Judged).rows)
        except DeviceFault:
            return []

    def _refuse(self, device: str = "") -> None:
        if self._fault is not None:
            raise self._fault
        if (failure := self.snapshot.faults.get(device)) is not None:
            raise failure.error(device)

    def _send(self, message: said.FromController) -> None:
        self._refuse()
        try:
            self._channel.send(message, self._limit_s)
        except (TimeoutError, EOFError) as error:
            self._gone(error)

    def _receive(self) -> said.ToController:
        try:
            answer: said.ToController = self._channel.receive(self._limit_s)
        except (TimeoutError, EOFError) as error:
            self._gone(error)
        return answer

    def _gone(self, error: Exception) -> NoReturn:
        """There is no way back: an answer that came late would be taken for that to another question."""
        silent = isinstance(error, TimeoutError)
        what = f"does not answer for {self._limit_s:g} s" if silent else "its process is gone"
        self._fault = LatchedFault(self._name, what)
        raise self._fault


class _LockStep:
    """The world's own time: sleeping is what advances it."""

    def __init__(self, cell: RemoteCell) -> None:
        self._cell = cell
        self._after_s = 0.0  # time goes on without a world, too, so that who waits for an arm ends

    def now_s(self) -> float:
        return max(self._cell.snapshot.time_s, self._after_s)

    def sleep_until(self, time_s: float) -> None:
        self._cell.renew(time_s)
        if self._cell.fault is not None:
            self._after_s = max(self._after_s, time_s)


class _Wall:
    """The wall's time, since the world's epoch; a world that stands begins with the first sleep.

    Attributes:
        delays: after the deadline of the last sleep, by cause: the machine woke us late, the world took time to answer.
    """

    def __init__(self, cell: RemoteCell, epoch_s: float | None) -> None:
        self._cell, self._epoch_s = cell, epoch_s
        self.delays: dict[str, float] = {}

    def now_s(self) -> float:
        return self._cell.snapshot.time_s if self._epoch_s is None else time.monotonic() - self._epoch_s

    def sleep_until(self, time_s: float) -> None:
        if self._epoch_s is None:
            self._epoch_s = self._begun()
        self._cell.flush()
        delay_s = time_s - self.now_s()
        if delay_s > 0:
            time.sleep(delay_s)
        woke_s = self.now_s()
        self._cell.renew()
        self.delays = {"machine": woke_s - time_s if delay_s > 0 else 0.0, "world": self.now_s() - woke_s}

    def _begun(self) -> float:
        """The epoch of a world that begins now; time goes on without one, too."""
        try:
            return self._cell.call(said.Begin(), said.Begun).epoch_s
        except DeviceFault:
            return time.monotonic() - self._cell.snapshot.time_s


class _Camera:
    def __init__(self, cell: RemoteCell, name: said.Camera) -> None:
        self._cell, self._name = cell, name

    def trigger(self) -> None:
        self._cell.order(said.Trigger(self._name))

    def latest(self) -> Frame | None:
        return self._cell.frame(self._name)


class _Arm:
    def __init__(self, cell: RemoteCell) -> None:
        self._cell = cell

    def state(self) -> ArmState:
        return self._cell.arm_state()

    def follow(self, trajectory: JointTrajectory) -> JointTrajectory:
        return self._cell.call(said.Follow(trajectory), said.Sent).trajectory or trajectory

    def stop(self) -> None:
        self._cell.order(said.Stop())

    def pace(self, share: float) -> None:
        self._cell.order(said.Share(share))

    def acknowledge(self) -> None:
        self._cell.order(said.Acknowledge())

    def samples(self) -> JointSamples | None:
        return self._cell.samples()


class _Gripper:
    def __init__(self, cell: RemoteCell) -> None:
        self._cell = cell

    def state(self) -> GripperState:
        return self._cell.gripper_state()

    def activate(self) -> None:
        self._cell.order(said.Activate())

    def command(self, command: GripperCommand) -> GripperCommand:
        return self._cell.call(said.Grip(command), said.Sent).command or command

    def hold(self) -> None:
        self._cell.order(said.Hold())

    def close(self) -> None:
        """It is the world's."""


class _Panel:
    def __init__(self, cell: RemoteCell) -> None:
        self._cell = cell

    def show(self, display: Display) -> None:
        self._cell.order(said.Show(display))

    def alarm(self, text: str) -> None:
        if self._cell.fault is None:
            self._cell.order(said.Alarm(text))


class _Host:
    """Detectors beside the frames, as the world's own devices offer it."""

    def __init__(self, cell: RemoteCell) -> None:
        self._cell = cell

    def await_ready(self) -> None:
        """They are: the world opens no earlier."""

    def begin(self, frame: Frame) -> Callable[[], BenchView | PartsView]:
        """See `DetectorHost`."""
        camera: said.Camera = "overhead" if frame.camera == "overhead" else "wrist"
        self._cell.order(said.Detect(camera, frame.sequence, frame.robot_m))
        question = said.Answer(camera)
        if camera == "overhead":
            return lambda: self._cell.call(question, Bench).view
        return lambda: self._cell.call(question, Tray).view


def _emptied(kept: list[Value]) -> list[Value]:
    taken = kept[:]
    kept.clear()
    return taken


def connected(address: Path) -> socket.socket:
    """A connection to the world at an address.

    Raises:
        InputError: no world is there.
    """
    trial = socket.socket(socket.AF_UNIX)
    try:
        trial.settimeout(1.0)  # where nobody takes those that wait
        trial.connect(str(address))
    except OSError as error:
        trial.close()
        raise InputError(f"{address}: no world is there: {error.strerror or error}") from None
    return trial
