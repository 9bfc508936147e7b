"""Serves a simulated cell to one controller at a time, and goes on when that controller is gone."""

from __future__ import annotations

import socket
import time
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from multiprocessing.connection import Connection, wait
from operator import attrgetter
from pathlib import Path
from typing import Any, TypeVar

from cell.errors import CellError, InputError
from cell.interfaces.command import Display
from cell.interfaces.devices import Devices
from cell.interfaces.observation import ArmState, GripperState, JointSamples
from cell.interfaces.perception import Frame, PendingFrame
from sim.process.buses import CarriedBuses
from sim.process.messages import Advance, Answer, Ask, Call, Drawn, Hello, Order, Pace, Refused, Snapshot, Welcome
from sim.process.pacing import Pacer

GONE_S = 1.0  # simulated time that passes when a controller in lock-step has gone: its arm stops by itself
KEPT_FRAMES = 8  # of a camera, that a detector may still be asked about
WAIT_S = 0.5


State = TypeVar("State", ArmState, GripperState)


class WorldServer:
    """A cell at an address.

    Args:
        buses: the CAN buses of the devices' process.
        period_s: step of the world on the wall's time.
        cell: what this cell is, by name; a controller that takes it for another one is refused.
        drawn: what the world was drawn from.
        private: it ends when its first controller has gone.
        watch: told the world's time after every advance; for trials.
    """

    def __init__(
        self,
        devices: Devices,
        buses: CarriedBuses,
        address: Path,
        period_s: float,
        cell: Mapping[str, str],
        drawn: Drawn,
        private: bool = False,
        watch: Callable[[float], None] = lambda _: None,
    ) -> None:
        self._drawn = drawn
        self._devices, self._buses, self._address, self._period_s = devices, buses, address, period_s
        self._cell, self._private, self._watch = dict(cell), private, watch
        self._connection: Connection | None = None
        self._pace: Pace = "fast"
        self._epoch_s = 0.0
        self._pacer: Pacer | None = None
        self._told: dict[str, int] = {}
        self._pending = {"overhead": deque[Frame](maxlen=KEPT_FRAMES), "wrist": deque[Frame](maxlen=KEPT_FRAMES)}
        self._hosted: list[Callable[[Frame], Callable[[], Any]]] = []
        self._answers: dict[int, Callable[[], Any]] = {}
        self._ended = False
        self._listener = _listen(address)

    def serve(self) -> None:
        """Serve until `end` is called, or a private world's controller is gone."""
        try:
            while not self._ended:
                self._serve_once()
        finally:
            self._hang_up()
            self._listener.close()
            self._buses.close()
            self._address.unlink(missing_ok=True)

    def end(self) -> None:
        """End soon."""
        self._ended = True

    def _serve_once(self) -> None:
        """One period of the world where it goes by itself, or one message, whichever comes first."""
        timeout_s = WAIT_S if self._pacer is None else min(WAIT_S, self._pacer.due_in_s())
        ready = wait([self._listener, *([self._connection] if self._connection is not None else [])], timeout_s)
        if self._connection in ready:  # first: who is gone makes room for the next one
            self._hear()
        if self._listener in ready:
            self._let_in()
        if self._pacer is not None:
            self._pacer.step()
            self._notice_frames()
            self._watch(self._devices.clock.now_s())

    def _let_in(self) -> None:
        taken, _ = self._listener.accept()
        connection = Connection(taken.detach())
        try:
            hello = connection.recv()
            if isinstance(hello, Ask):
                connection.send(self._drawn)
                connection.close()
                return
            problem = self._refusal(hello)
            if problem:
                connection.send(Refused(problem))
                connection.close()
                return
            self._connection, self._pace = connection, hello.pace
            self._told = {}
            self._hosted, self._answers = [], {}
            self._buses.take()  # what was said to one who is gone
            if self._pace == "fast":
                self._pacer = None
            self._devices.free_running(self._pace == "real")
            epoch_s = None if self._pacer is None else self._epoch_s
            connection.send(Welcome(epoch_s, self._devices.host is not None, self._snapshot()))
        except (EOFError, OSError):
            self._hang_up()

    def _refusal(self, hello: object) -> str:
        if not isinstance(hello, Hello):
            return "the controller has another version"
        if self._connection is not None:
            return "another controller is connected"
        differs = [name for name, value in self._cell.items() if hello.cell.get(name) != value]
        return f"the world was opened with another {' and another '.join(differs)}" if differs else ""

    def _hear(self) -> None:
        assert self._connection is not None
        try:
            message = self._connection.recv()
            if isinstance(message, Order):
                self._do(message)
            elif isinstance(message, Call):
                self._connection.send(self._answered(message))
            elif isinstance(message, Advance):
                if self._pacer is None and message.until_s is not None:
                    self._devices.clock.sleep_until(message.until_s)
                    self._watch(self._devices.clock.now_s())
                self._connection.send(self._snapshot())
        except (EOFError, OSError):
            self._controller_gone()

    def _controller_gone(self) -> None:
        """Nobody commands any more: questions go, and an arm that hears nothing stops by itself."""
        self._hang_up()
        with suppress(CellError):
            self._devices.panel.show(Display())
        self._devices.panel.alarm("")
        if self._private:
            self._ended = True
        elif self._pacer is None:
            self._devices.clock.sleep_until(self._devices.clock.now_s() + GONE_S)

    def _hang_up(self) -> None:
        if self._connection is not None:
            self._connection.close()
            self._connection = None

    def _do(self, order: Order) -> None:
        """An order whose failure shows in the device's state."""
        if order.what == "can":
            self._buses.put(*order.arguments)
        elif order.what == "host.begin":
            number, detector, camera, sequence, robot_m = order.arguments
            frame = next((one for one in self._pending[camera] if one.sequence == sequence), None)
            if frame is not None:
                self._answers[number] = self._hosted[detector](frame.beside(robot_m))
        else:
            with suppress(CellError):
                self._method(order.what)(*order.arguments)

    def _answered(self, call: Call) -> Answer:
        try:
            if call.what == "begin":
                return Answer(self._begin_pace())
            if call.what == "host.build":
                assert self._devices.host is not None
                build, *arguments = call.arguments
                self._hosted.append(self._devices.host.host(build, *arguments))
                return Answer(len(self._hosted) - 1)
            if call.what == "host.answer":
                return Answer(self._answers.pop(call.arguments[0])())
            value = self._method(call.what)(*call.arguments)
            return Answer(
                None if any(value is one for one in call.arguments) else value
            )  # followed as it was asked for
        except CellError as error:
            return Answer(error=error)

    def _begin_pace(self) -> float:
        """From now on the world goes with the wall's time; its epoch."""
        if self._pacer is None:
            self._epoch_s = time.monotonic() - self._devices.clock.now_s()
            self._pacer = Pacer(self._devices.clock, self._period_s, self._epoch_s)
        return self._epoch_s

    def _method(self, what: str) -> Callable[..., Any]:
        method: Callable[..., Any] = attrgetter(what)(self._devices)
        return method

    def _snapshot(self) -> Snapshot:
        self._notice_frames()
        time_s, devices = self._wall_s(self._devices.clock.now_s()), self._devices
        frames, faults = [], {}
        for name in self._pending:
            try:
                frame = self._new_frame(name)
            except CellError as error:
                faults[name] = error
                continue
            if frame is not None:
                frames.append(frame)
        return Snapshot(
            time_s,
            self._state_of(self._devices.arm.state),
            self._state_of(self._devices.gripper.state),
            self._samples(),
            tuple(frames),
            faults,
            tuple(devices.pressed()),
            tuple(replace(event, time_s=self._wall_s(event.time_s)) for event in devices.truth()),
            self._buses.take(),
            0.0 if self._pacer is None else self._pacer.lost_s,
        )

    def _state_of(self, device: Callable[[], State]) -> State | CellError:
        try:
            state = device()
        except CellError as error:
            return error
        return state if self._pacer is None else replace(state, time_s=self._wall_s(state.time_s))

    def _samples(self) -> JointSamples | None:
        with suppress(CellError):
            samples = self._devices.arm.samples()
            if samples is None or self._pacer is None or not len(samples.times_s):
                return samples
            return replace(
                samples, times_s=samples.times_s + (self._wall_s(float(samples.times_s[-1])) - samples.times_s[-1])
            )
        return None

    def _notice_frames(self) -> None:
        """Keep new frames of both cameras, whose images may still be made."""
        for name, kept in self._pending.items():
            with suppress(CellError):  # who asks for the frame is told
                frame = getattr(self._devices, name).latest()
                if frame is not None and (not kept or frame.sequence > kept[-1].sequence):
                    kept.append(frame)

    def _new_frame(self, name: str) -> Frame | None:
        """The newest frame that was not told yet; on the wall's time only one that is ready."""
        getattr(self._devices, name).latest()  # raises where no more will come
        ready = [one for one in self._pending[name] if self._pacer is None or _is_ready(one)]
        if not ready or ready[-1].sequence <= self._told.get(name, -1):
            return None
        newest = ready[-1]
        self._told[name] = newest.sequence
        time_s = self._wall_s(newest.time_s)
        return Frame(newest.camera, newest.sequence, time_s, newest.image, newest.world_from_camera)

    def _wall_s(self, world_s: float) -> float:
        return world_s if self._pacer is None else self._pacer.wall_s(world_s)


def _is_ready(frame: Frame) -> bool:
    return frame.ready if isinstance(frame, PendingFrame) else True


def _listen(address: Path) -> socket.socket:
    """A socket that only this user can open.

    Raises:
        InputError: the address cannot be had, or another world is there.
    """
    listener = socket.socket(socket.AF_UNIX)
    try:
        if address.is_socket() and not _alive(address):
            address.unlink()
        listener.bind(str(address))
        address.chmod(0o600)
        listener.listen(1)
    except OSError as error:
        listener.close()
        raise InputError(f"{address}: no world can be reached there: {error.strerror or error}") from None
    return listener


def _alive(address: Path) -> bool:
    with socket.socket(socket.AF_UNIX) as trial:
        try:
            trial.connect(str(address))
        except OSError:
            return False
    return True
