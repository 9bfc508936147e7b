"""The devices of a cell that lives in another process."""

from __future__ import annotations

import itertools
import socket
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from cell.errors import DeviceFault, InputError
from cell.interfaces.clock import Clock
from cell.interfaces.command import Display, GripperCommand, JointTrajectory
from cell.interfaces.devices import Devices, TruthEvent
from cell.interfaces.observation import ArmState, GripperState, JointSamples
from cell.interfaces.operator import OperatorOrder
from cell.interfaces.perception import Frame
from sim.process.buses import CarriedBuses
from sim.process.messages import Advance, Answer, Call, Hello, Order, Pace, Refused, Snapshot, Welcome

Value = TypeVar("Value")
NAME = "world"
RETRY_S = 0.05


class RemoteCell:
    """A connection to a world, with its devices.

    Attributes:
        devices: as in the world's own process.

    Args:
        buses: this process's ends of the virtual CAN buses.
        patience_s: how long to wait for a world that is not there yet.
        alive: whether it is worth waiting.

    Raises:
        InputError: no world is there, or it does not accept such a controller.
    """

    def __init__(
        self,
        address: Path,
        pace: Pace,
        cell: Mapping[str, str],
        buses: CarriedBuses,
        patience_s: float = 0.0,
        alive: Callable[[], bool] = lambda: True,
        closed: Callable[[], None] = lambda: None,
    ) -> None:
        self._buses, self._closed = buses, closed
        self._lock = threading.RLock()
        self._fault: DeviceFault | None = None
        self._numbers = itertools.count()
        self._connection = connected(address, patience_s, alive)
        self._connection.send(Hello(pace, dict(cell)))
        try:
            welcome = self._connection.recv()
        except (EOFError, OSError):
            welcome = Refused("it hung up")
        if not isinstance(welcome, Welcome):
            self._connection.close()
            raise InputError(f"{address}: the world takes no controller: {welcome.reason}")
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
            report=lambda: self._told("report", {}),
            close=self.close,
            truth=lambda: _emptied(self._truth),
            pressed=lambda: _emptied(self._pressed),
            finished=lambda: self._told("finished", []),
            host=_Host(self) if welcome.hosts and pace == "fast" else None,
            lost_s=lambda: self.snapshot.lost_s,
        )

    @property
    def fault(self) -> DeviceFault | None:
        """Why the world is gone; None as long as it is there."""
        return self._fault

    def order(self, what: str, *arguments: Any) -> None:
        """Let something be done, in the order of the calls."""
        with self._lock:
            self._send(Order(what, arguments))

    def call(self, what: str, *arguments: Any) -> Any:
        """Let something be done, and wait for what it returns; raises what it raised."""
        with self._lock:
            self.flush()
            self._send(Call(what, arguments))
            answer = self._receive()
        assert isinstance(answer, Answer)
        if answer.error is not None:
            raise answer.error
        return answer.value

    def flush(self) -> None:
        """What was sent on the CAN buses goes to the world; nothing happens where that is gone."""
        with suppress(DeviceFault):
            if frames := self._buses.take():
                self.order("can", frames)

    def renew(self, until_s: float | None = None) -> None:
        """Ask how things are; in lock-step after the world has advanced.

        Where the world is gone, its devices say so.
        """
        self.flush()
        with self._lock, suppress(DeviceFault):
            self._send(Advance(until_s))
            self._take(self._receive())

    def frame(self, camera: str) -> Frame | None:
        """Newest frame of a camera; raises what the camera raises."""
        self._refuse()
        if (error := self.snapshot.faults.get(camera)) is not None:
            raise error
        return self._frames.get(camera)

    def arm_state(self) -> ArmState:
        """As the world told last; raises what the arm raised."""
        self._refuse()
        if isinstance(self.snapshot.arm, ArmState):
            return self.snapshot.arm
        raise self.snapshot.arm

    def gripper_state(self) -> GripperState:
        """As the world told last; raises what the gripper raised."""
        self._refuse()
        if isinstance(self.snapshot.gripper, GripperState):
            return self.snapshot.gripper
        raise self.snapshot.gripper

    def samples(self) -> JointSamples | None:
        """What the arm measured since the last call."""
        self._refuse()
        taken = _emptied(self._samples)
        if len(taken) <= 1:
            return taken[0] if taken else None
        columns = ("times_s", "positions_rad", "velocities_rad_s", "efforts_nm")
        return JointSamples(*(np.concatenate([getattr(one, name) for one in taken]) for name in columns))

    def next_number(self) -> int:
        """Tells the jobs of hosted detectors apart."""
        return next(self._numbers)

    def close(self) -> None:
        """Leave the world."""
        with self._lock:
            self._connection.close()
            self._buses.close()
            self._fault = self._fault or DeviceFault(NAME, "it was left")
        self._closed()

    def _take(self, snapshot: Snapshot) -> None:
        self.snapshot = snapshot
        self._frames.update({frame.camera: frame for frame in snapshot.frames})
        self._pressed += snapshot.pressed
        self._truth += snapshot.truth
        if snapshot.samples is not None:
            self._samples.append(snapshot.samples)
        self._buses.put(snapshot.can)

    def _told(self, what: str, otherwise: Value) -> Value:
        """What the world says, or something else where it is gone."""
        try:
            value: Value = self.call(f"{what}")
        except DeviceFault:
            return otherwise
        return value

    def _refuse(self) -> None:
        if self._fault is not None:
            raise self._fault

    def _send(self, message: object) -> None:
        self._refuse()
        try:
            self._connection.send(message)
        except OSError:
            self._gone()

    def _receive(self) -> Any:
        try:
            return self._connection.recv()
        except (EOFError, OSError):
            self._gone()

    def _gone(self) -> None:
        self._fault = DeviceFault(NAME, "its process is gone")
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
            return float(self._cell.call("begin"))
        except DeviceFault:
            return time.monotonic() - self._cell.snapshot.time_s


class _Camera:
    def __init__(self, cell: RemoteCell, name: str) -> None:
        self._cell, self._name = cell, name

    def trigger(self) -> None:
        self._cell.order(f"{self._name}.trigger")

    def latest(self) -> Frame | None:
        return self._cell.frame(self._name)


class _Arm:
    def __init__(self, cell: RemoteCell) -> None:
        self._cell = cell

    def state(self) -> ArmState:
        return self._cell.arm_state()

    def follow(self, trajectory: JointTrajectory) -> JointTrajectory:
        sent: JointTrajectory | None = self._cell.call("arm.follow", trajectory)
        return trajectory if sent is None else sent

    def stop(self) -> None:
        self._cell.order("arm.stop")

    def pace(self, share: float) -> None:
        self._cell.order("arm.pace", share)

    def acknowledge(self) -> None:
        self._cell.order("arm.acknowledge")

    def samples(self) -> JointSamples | None:
        return self._cell.samples()


class _Gripper:
    def __init__(self, cell: RemoteCell) -> None:
        self._cell = cell

    def state(self) -> GripperState:
        return self._cell.gripper_state()

    def activate(self) -> None:
        self._cell.order("gripper.activate")

    def command(self, command: GripperCommand) -> GripperCommand:
        sent: GripperCommand | None = self._cell.call("gripper.command", command)
        return command if sent is None else sent

    def hold(self) -> None:
        self._cell.order("gripper.hold")

    def close(self) -> None:
        """It is the world's."""


class _Panel:
    def __init__(self, cell: RemoteCell) -> None:
        self._cell = cell

    def show(self, display: Display) -> None:
        self._cell.order("panel.show", display)

    def alarm(self, text: str) -> None:
        if self._cell.fault is None:
            self._cell.order("panel.alarm", text)


class _Host:
    """Detectors beside the frames, as the world's own devices offer it."""

    def __init__(self, cell: RemoteCell) -> None:
        self._cell = cell

    def host(
        self, build: Callable[..., Callable[[Frame], Value]], *arguments: object
    ) -> Callable[[Frame], Callable[[], Value]]:
        """See `DetectorHost`."""
        detector = self._cell.call("host.build", build, *arguments)

        def begin(frame: Frame) -> Callable[[], Value]:
            number = self._cell.next_number()
            self._cell.order("host.begin", number, detector, frame.camera, frame.sequence, frame.robot_m)
            return lambda: self._cell.call("host.answer", number)

        return begin


def _emptied(kept: list[Value]) -> list[Value]:
    taken = kept[:]
    kept.clear()
    return taken


def connected(address: Path, patience_s: float = 0.0, alive: Callable[[], bool] = lambda: True) -> Connection:
    """A connection to the world at an address.

    Raises:
        InputError: no world is there.
    """
    until_s = time.monotonic() + patience_s
    while True:
        trial = socket.socket(socket.AF_UNIX)
        try:
            trial.connect(str(address))
            return Connection(trial.detach())
        except OSError as error:
            trial.close()
            if time.monotonic() >= until_s or not alive():
                raise InputError(f"{address}: no world is there: {error.strerror or error}") from None
        time.sleep(RETRY_S)
