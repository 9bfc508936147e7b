"""Serves a simulated cell to one controller at a time, and goes on when that controller is gone."""

from __future__ import annotations

import os
import select
import socket
import struct
import time
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from bracket_cell.remote.channel import Channel, Failure
from bracket_cell.remote.detecting import seen
from bracket_ground.errors import CellError, InputError
from bracket_ground.interfaces.command import Display
from bracket_ground.interfaces.devices import Devices
from bracket_ground.interfaces.frame import Frame, PendingFrame
from bracket_ground.interfaces.observation import ArmState, GripperState, JointSamples
from bracket_ground.interfaces.perception import BenchView, PartsView
from bracket_sim.devices.pacing import Pacer
from bracket_sim.process import messages as said
from bracket_sim.process.buses import CarriedBuses

GONE_S = 1.0  # simulated time that passes when a controller in lock-step has gone: its arm stops by itself
KEPT_FRAMES = 8  # of a camera, that a detector may still be asked about
WAIT_S = 0.5
HELLO_S, NEWCOMERS, HELLO_BYTES = 1.0, 8, 4096  # of those that have not said who they are
SEND_S = 1.0  # in which a controller must read an answer

State = TypeVar("State", ArmState, GripperState)


class WorldServer:
    """A cell for controllers.

    Args:
        buses: the CAN buses of the devices' process.
        door: where controllers come: an address, or the connection to the only one, with whom it ends.
        period_s: step of the world on the wall's time.
        cell: what this cell is, by name; a controller that takes it for another one is refused.
        drawn: what the world was drawn from.
        watch: told the world's time after every advance; for trials.

    Raises:
        InputError: the address cannot be had, or another world is there.
    """

    def __init__(
        self,
        devices: Devices,
        buses: CarriedBuses,
        door: Path | socket.socket,
        period_s: float,
        cell: Mapping[str, str],
        drawn: said.Drawn,
        watch: Callable[[float], None] = lambda _: None,
    ) -> None:
        self._devices, self._buses, self._period_s = devices, buses, period_s
        self._cell, self._drawn, self._watch = dict(cell), drawn, watch
        self._controller: Channel[Any] | None = None
        self._newcomers: dict[Channel[Any], float] = {}  # until when they may say who they are
        self._pace: said.Pace = "fast"
        self._epoch_s = 0.0
        self._pacer: Pacer | None = None
        self._told: dict[str, int] = {}
        self._pending = {"overhead": deque[Frame](maxlen=KEPT_FRAMES), "wrist": deque[Frame](maxlen=KEPT_FRAMES)}
        self._answers: dict[str, deque[Callable[[], BenchView | PartsView]]] = {}
        self._ended = False
        self._address = door if isinstance(door, Path) else None
        self._listener = _listen(door) if isinstance(door, Path) else None
        if not isinstance(door, Path):
            self._newcomers[_newcomer(door)] = float("inf")

    def serve(self) -> None:
        """Serve until `end` is called, or the only controller is gone."""
        try:
            while not self._ended:
                self._serve_once()
        finally:
            for newcomer in (*self._newcomers, self._controller, self._listener):
                if newcomer is not None:
                    newcomer.close()
            self._buses.close()
            if self._address is not None:
                self._address.unlink(missing_ok=True)

    def end(self) -> None:
        """End soon."""
        self._ended = True

    def _serve_once(self) -> None:
        """One period of the world where it goes by itself, or one message, whichever comes first."""
        ready = self._ready(WAIT_S if self._pacer is None else min(WAIT_S, self._pacer.due_in_s()))
        if self._controller is not None and self._controller.fileno() in ready:
            self._hear(self._controller)  # first: who is gone makes room for the next one
        for newcomer, until_s in list(self._newcomers.items()):
            if newcomer.fileno() in ready or time.monotonic() > until_s:
                self._greet(newcomer, until_s)
        if self._listener is not None and self._listener.fileno() in ready:
            self._accept(self._listener)
        if self._pacer is not None:
            self._pacer.step()
            self._notice_frames()
            self._watch(self._devices.clock.now_s())

    def _ready(self, limit_s: float) -> set[int]:
        poll = select.poll()
        for newcomer in (self._listener, self._controller, *self._newcomers):
            if newcomer is not None:
                poll.register(newcomer.fileno(), select.POLLIN)
        return {handle for handle, _ in poll.poll(1e3 * limit_s)}

    def _accept(self, listener: socket.socket) -> None:
        """Somebody came: a process of this user, which has a second to say what it wants."""
        taken, _ = listener.accept()
        if len(self._newcomers) >= NEWCOMERS or peer(taken)[1] != os.geteuid():
            taken.close()
        else:
            self._newcomers[_newcomer(taken)] = time.monotonic() + HELLO_S

    def _greet(self, newcomer: Channel[Any], until_s: float) -> None:
        """Whatever a newcomer does ends its own connection alone."""
        try:
            hello = newcomer.taken()
            if hello is None and time.monotonic() <= until_s:
                return
            del self._newcomers[newcomer]
            answer = self._answer_to(hello)
            newcomer.send(answer, SEND_S if isinstance(answer, said.Welcome) else 0.0)
        except (EOFError, TimeoutError):
            answer = said.Refused("")
        if isinstance(answer, said.Welcome):
            self._controller = newcomer.hearing(said.FromController)
            return
        self._newcomers.pop(newcomer, None)
        newcomer.close()
        self._ended |= self._listener is None

    def _answer_to(self, hello: said.Hello | said.Ask | None) -> said.Welcome | said.Refused | said.Drawn:
        if isinstance(hello, said.Ask):
            return self._drawn
        if hello is None:
            return said.Refused(f"nothing was said for {HELLO_S:g} s")
        if self._controller is not None:
            return said.Refused("another controller is connected")
        differs = [name for name, value in self._cell.items() if hello.cell.get(name) != value]
        if differs:
            return said.Refused(f"the world was opened with another {' and another '.join(differs)}")
        self._pace, self._told, self._answers = hello.pace, {}, {"overhead": deque(), "wrist": deque()}
        self._buses.take()  # what was said to one who is gone
        if self._pace == "fast":
            self._pacer = None
        self._devices.free_running(self._pace == "real")
        epoch_s = None if self._pacer is None else self._epoch_s
        return said.Welcome(epoch_s, self._devices.host is not None, self._snapshot())

    def _hear(self, controller: Channel[Any]) -> None:
        try:
            while (message := controller.taken()) is not None:
                if isinstance(message, said.Order):
                    with suppress(CellError):  # whose failure shows in the device's state
                        self._do(message)
                else:
                    controller.send(self._answered(message), SEND_S)
        except (EOFError, TimeoutError):
            self._controller_gone(controller)

    def _controller_gone(self, controller: Channel[Any]) -> None:
        """Nobody commands any more: questions go, and an arm that hears nothing stops by itself."""
        controller.close()
        self._controller = None
        with suppress(CellError):
            self._devices.panel.show(Display())
        self._devices.panel.alarm("")
        if self._listener is None:
            self._ended = True
        elif self._pacer is None:
            self._devices.clock.sleep_until(self._devices.clock.now_s() + GONE_S)

    def _do(self, order: said.Order) -> None:
        arm, gripper, panel = self._devices.arm, self._devices.gripper, self._devices.panel
        match order:
            case said.Stop():
                arm.stop()
            case said.Share(share):
                arm.pace(share)
            case said.Acknowledge():
                arm.acknowledge()
            case said.Activate():
                gripper.activate()
            case said.Hold():
                gripper.hold()
            case said.Trigger(camera):
                getattr(self._devices, camera).trigger()
            case said.Show(display):
                panel.show(display)
            case said.Alarm(text):
                panel.alarm(text)
            case said.Upset(name):
                if self._devices.upset is not None:
                    self._devices.upset(name)
            case said.Can(frames):
                self._buses.put(frames)
            case said.Detect(camera, sequence, robot_m):
                frame = next((image for image in self._pending[camera] if image.sequence == sequence), None)
                if frame is not None and self._devices.host is not None:
                    self._answers[camera].append(self._devices.host.begin(frame.beside(robot_m)))

    def _answered(self, call: said.Call) -> said.ToController:
        try:
            return self._called(call)
        except CellError as error:
            return Failure.of(error)

    def _called(self, call: said.Call) -> said.ToController:
        match call:
            case said.Advance(until_s):
                if self._pacer is None and until_s is not None:
                    self._devices.clock.sleep_until(until_s)
                    self._watch(self._devices.clock.now_s())
                return self._snapshot()
            case said.Follow(trajectory):
                sent = self._devices.arm.follow(trajectory)
                return said.Sent(trajectory=None if sent is trajectory else sent)
            case said.Grip(command):
                return said.Sent(command=self._devices.gripper.command(command))
            case said.Answer(camera):
                if not self._answers[camera]:
                    raise InputError(f"no frame of the camera {camera} is being answered")
                return seen(self._answers[camera].popleft()())
            case said.Begin():
                return said.Begun(self._begin_pace())
            case said.Report():
                return said.Judged([self._devices.report()])
            case said.Finished():
                return said.Judged(self._devices.finished())

    def _begin_pace(self) -> float:
        """From now on the world goes with the wall's time; its epoch."""
        if self._pacer is None:
            self._epoch_s = time.monotonic() - self._devices.clock.now_s()
            self._pacer = Pacer(self._devices.clock, self._period_s, self._epoch_s)
        return self._epoch_s

    def _snapshot(self) -> said.Snapshot:
        self._notice_frames()
        devices, faults = self._devices, dict[str, Failure]()
        frames = [frame for name in self._pending if (frame := self._new_frame(name, faults)) is not None]
        return said.Snapshot(
            self._wall_s(devices.clock.now_s()),
            self._state_of(devices.arm.state, "arm", faults),
            self._state_of(devices.gripper.state, "gripper", faults),
            faults,
            self._samples(),
            tuple(frames),
            tuple(devices.pressed()),
            tuple(replace(event, time_s=self._wall_s(event.time_s)) for event in devices.truth()),
            self._buses.take(),
            0.0 if self._pacer is None else self._pacer.lost_s,
        )

    def _state_of(self, device: Callable[[], State], name: str, faults: dict[str, Failure]) -> State | None:
        try:
            state = device()
        except CellError as error:
            faults[name] = Failure.of(error)
            return None
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

    def _new_frame(self, name: str, faults: dict[str, Failure]) -> Frame | None:
        """The newest frame that was not told yet; on the wall's time only one that is ready."""
        ready = [frame for frame in self._pending[name] if self._pace == "fast" or _is_ready(frame)]
        try:
            getattr(self._devices, name).latest()  # raises where no more will come
            if not ready or ready[-1].sequence <= self._told.get(name, -1):
                return None
            newest, self._told[name] = ready[-1], ready[-1].sequence
            time_s = self._wall_s(newest.time_s)
            stamp = newest.camera, newest.sequence, time_s
            return Frame(*stamp, newest.image, newest.world_from_camera, depth_mm=newest.depth_mm)
        except CellError as error:
            faults[name] = Failure.of(error)
            return None

    def _wall_s(self, world_s: float) -> float:
        return world_s if self._pacer is None else self._pacer.wall_s(world_s)


def _is_ready(frame: Frame) -> bool:
    return frame.ready if isinstance(frame, PendingFrame) else True


def _newcomer(connection: socket.socket) -> Channel[Any]:
    return Channel(connection, said.FromNewcomer, HELLO_BYTES)


def _listen(address: Path) -> socket.socket:
    """A socket that only this user can open, from its first moment on.

    Raises:
        InputError: the address cannot be had, or another world is there.
    """
    listener, mask = socket.socket(socket.AF_UNIX), os.umask(0o177)
    try:
        if address.is_socket() and not _alive(address):
            address.unlink()
        listener.bind(str(address))
        listener.listen(NEWCOMERS)
    except OSError as error:
        listener.close()
        raise InputError(f"{address}: no world can be reached there: {error.strerror or error}") from None
    finally:
        os.umask(mask)
    return listener


def _alive(address: Path) -> bool:
    with socket.socket(socket.AF_UNIX) as trial:
        try:
            trial.connect(str(address))
        except OSError:
            return False
    return True


def peer(connection: socket.socket) -> tuple[int, int]:
    """Process and user at the other end; where the system does not tell, 0 and this one: the socket's mode counts."""
    if not hasattr(socket, "SO_PEERCRED"):
        return 0, os.geteuid()
    form = struct.Struct("3i")
    process, user, _ = form.unpack(connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, form.size))
    return process, user
