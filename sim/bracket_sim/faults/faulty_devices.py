"""Devices, detectors, a panel and a CAN bus with faults: they answer as broken ones would; no controller knows."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Generic, Protocol, TypeVar, cast

import can
import numpy as np

from bracket_cell.running.inference import Executor
from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.command import JointTrajectory
from bracket_ground.interfaces.devices import Arm, Camera
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.observation import ArmState, JointSamples
from bracket_ground.interfaces.operator import OperatorOrder, OrderKind
from bracket_sim.faults.signal_faults import GROUPS, SignalFault

AGAIN_S = 0.2  # after which a repeated order comes once more, and a foreign frame
STATUS, FRAMES = "GripperStatus", "frames"
FLIPS: dict[OrderKind, OrderKind] = {"pause": "resume", "resume": "pause"}
Value = TypeVar("Value")
Job = TypeVar("Job")
View = TypeVar("View")


class Injected(Protocol):
    """What a proxy asks.

    Attributes:
        shown: a device has answered with the fault.
        first_frame: number of the first frame that it spoiled.
    """

    shown: bool
    first_frame: int | None

    def on(self, device: str) -> Sequence[SignalFault]:
        """Faults of a device that are there now."""
        ...

    def now_s(self) -> float:
        """The cell's time."""
        ...

    def acknowledged(self) -> None:
        """Somebody acknowledged what the arm tells."""
        ...


def with_faults(state: Value, faults: Sequence[SignalFault], now_s: float) -> Value:
    """A state or frame as faults have its fields."""
    for fault in faults:
        names = GROUPS.get(fault.signal, (fault.signal,))
        if len(names) == 1:
            changed = {fault.signal: fault.apply(getattr(state, fault.signal), now_s)}
        else:  # all fields of one answer
            if fault.kind == "lost":
                raise DeviceFault(fault.device, "connection lost")
            answer = fault.apply(state, now_s)
            changed = {name: getattr(answer, name) for name in names}
        state = replace(state, **changed)  # type: ignore[type-var]
    return state


class FaultyArm:
    """An arm with faults in what it tells and in how it takes orders."""

    def __init__(self, arm: Arm, injection: Injected) -> None:
        self._arm, self._injection = arm, injection
        self._waiting: list[tuple[float, Callable[[], object]]] = []
        self._gone: set[SignalFault] = set()  # orders that nobody gave

    def state(self) -> ArmState:
        now_s = self._injection.now_s()
        due = [order for when_s, order in self._waiting if when_s <= now_s]
        self._waiting = [order for order in self._waiting if order[0] > now_s]
        for order in due:
            order()
        faults = self._injection.on("arm")
        for fault in faults:
            if (fault.signal, fault.kind) == ("stop", "foreign") and fault not in self._gone:
                self._gone.add(fault)
                self._injection.shown = True
                self._arm.stop()
            if fault.signal == "answer" and fault.kind == "refused":
                self._injection.shown = True
                raise DeviceFault("arm", "connection lost")
        of_state = [fault for fault in faults if fault.signal not in ("follow", "pace", "stop", "acknowledge")]
        state = self._arm.state()
        answer = with_faults(state, of_state, now_s)
        self._injection.shown |= answer != state
        return answer

    def follow(self, trajectory: JointTrajectory) -> JointTrajectory:
        self._order("follow", trajectory, self._arm.follow)
        return trajectory

    def stop(self) -> None:
        self._order("stop", None, lambda _: self._arm.stop())

    def pace(self, share: float) -> None:
        self._order("pace", float(share), self._arm.pace)

    def acknowledge(self) -> None:
        self._injection.acknowledged()
        self._order("acknowledge", None, lambda _: self._arm.acknowledge())

    def samples(self) -> JointSamples | None:
        return self._arm.samples()

    def _order(self, signal: str, value: Value, act: Callable[[Value], object]) -> None:
        """Carry it out as the faults have it."""
        now_s = self._injection.now_s()
        for fault in self._injection.on("arm"):
            if fault.signal != signal or (value is None and fault.kind == "foreign"):
                continue
            self._injection.shown = True
            if fault.kind == "refused":
                raise DeviceFault("arm", f"refuses the order: {signal}")
            if fault.kind == "lost":
                return
            if fault.kind in ("late", "repeated"):
                late_s = fault.number if fault.kind == "late" else AGAIN_S
                self._waiting.append((now_s + late_s, partial(act, value)))
                if fault.kind == "late":
                    return
            elif value is not None:
                value = fault.apply(value, now_s)
        act(value)


class FaultyCamera:
    """A camera with faults in its frames."""

    def __init__(self, camera: Camera, device: str, injection: Injected) -> None:
        self._camera, self._device, self._injection = camera, device, injection
        self._last: Frame | None = None

    def trigger(self) -> None:
        self._camera.trigger()

    def latest(self) -> Frame | None:
        frame, faults = self._camera.latest(), self._injection.on(self._device)
        if frame is None or not faults:
            self._last = frame
            return frame
        now_s = self._injection.now_s()
        for fault in faults:
            if fault.kind == "refused":
                raise OSError(19, "No such device")
            if fault.signal == "frame":
                frame = self._last if fault.kind == "lost" else fault.apply(frame, now_s)
            elif frame is not None:
                seen = frame.camera, frame.sequence, frame.time_s, frame.image
                true = Frame(*seen, frame.world_from_camera, depth_mm=frame.depth_mm)
                frame = with_faults(true, [fault], now_s)
                new = self._last is None or frame.sequence > self._last.sequence
                if new and self._injection.first_frame is None:
                    self._injection.first_frame = frame.sequence
        return frame


class FaultyPanel:
    """What is pressed at the bench, with faults; `pressed` of the devices."""

    def __init__(self, pressed: Callable[[], Sequence[OperatorOrder]], injection: Injected) -> None:
        self._pressed, self._injection = pressed, injection
        self._waiting: list[tuple[float, OperatorOrder]] = []
        self._last: tuple[OperatorOrder, ...] = ()
        self._gone = False

    def __call__(self) -> Sequence[OperatorOrder]:
        now_s, orders = self._injection.now_s(), tuple(self._pressed())
        for fault in self._injection.on("panel"):
            orders = tuple(self._told(fault, orders, now_s))
        due = [order for when_s, order in self._waiting if when_s <= now_s]
        self._waiting = [order for order in self._waiting if order[0] > now_s]
        return (*orders, *due)

    def _told(self, fault: SignalFault, orders: tuple[OperatorOrder, ...], now_s: float) -> Iterator[OperatorOrder]:
        self._last = orders or self._last
        if fault.kind == "foreign" and not self._gone:
            self._gone = True
            yield _pressed(str(fault.size))
        if fault.kind == "late":
            self._waiting += [(now_s + fault.number, order) for order in orders]
        elif fault.kind == "stuck":
            yield from self._last
        elif fault.kind == "flipped":
            yield from (_pressed(FLIPS.get(order.kind, order.kind)) for order in orders)
        elif fault.kind != "lost":
            yield from orders * (2 if fault.kind == "repeated" else 1)


class FaultyDetector(Generic[Job, View]):
    """A detector with faults in its answers. Implements `Executor`.

    Args:
        whole, single: by what names faults call its answer, and what is in it.
    """

    def __init__(self, detector: Executor[Job, View], injection: Injected, whole: str, single: Sequence[str]) -> None:
        self._detector, self._injection, self._whole, self._single = detector, injection, whole, single
        self.submit, self.close = detector.submit, detector.close

    def poll(self) -> View | None:
        """The answer as the faults have it."""
        true, now_s = self._detector.poll(), self._injection.now_s()
        view: Any = true
        for fault in self._injection.on(self._whole):
            if view is None or (fault.signal, fault.kind) == ("answer", "lost"):
                view = None
            elif fault.signal == "answer":
                view = fault.apply(view, now_s)
            elif fault.signal == "view":
                view = replace(fault.apply(view, now_s), sequence=view.sequence, time_s=view.time_s)
            else:
                view = with_faults(view, [fault], now_s)
        for name in self._single:
            for fault in self._injection.on(name):
                view = view and _within_view(view, name, fault, now_s)
        self._injection.shown |= view is not true
        return cast("View | None", view)


def _within_view(view: Any, name: str, fault: SignalFault, now_s: float) -> Any:
    """A view with the fault in its hand, or in each of its holes or parts."""
    if name == "hand":
        return view if view.hand is None else replace(view, hand=with_faults(view.hand, [fault], now_s))
    if name == "hole":
        return replace(view, holes={place: with_faults(hole, [fault], now_s) for place, hole in view.holes.items()})
    poses = (with_faults(detection.world_from_part, [fault], now_s) for detection in view.detections)
    moved = zip(view.detections, poses, strict=True)
    return replace(view, detections=tuple(replace(part, world_from_part=pose) for part, pose in moved))


def _pressed(kind: str) -> OperatorOrder:
    kinds: dict[str, OrderKind] = {"pause": "pause", "resume": "resume", "stop": "stop"}
    return OperatorOrder(kinds.get(kind, "acknowledge"), "now" if kind == "pause" else "")


class FaultyBus:
    """A CAN bus with faults: frames are lost, late, doubled or of somebody else, registers are wrong."""

    def __init__(self, bus: can.BusABC, injection: Injected, database: Any) -> None:
        self._bus, self._injection, self._database = bus, injection, database
        self._names = {message.frame_id: message.name for message in database.messages}
        self._waiting: list[tuple[float, bool, can.Message]] = []  # due when, to be sent, what
        self._foreign_s: dict[SignalFault, float] = {}
        self._others: list[bytes] = []  # commands of another master, which no echo of ours are

    def recv(self, timeout: float | None = None) -> can.Message | None:
        now_s, faults = self._injection.now_s(), self._injection.on("bus")
        for fault in faults:
            if fault.kind == "refused":
                self._injection.shown = True
                raise can.CanOperationError("bus off")
            self._intrude(fault, now_s)
        while (due := next((frame for frame in self._waiting if frame[0] <= now_s), None)) is not None:
            self._waiting.remove(due)
            if not due[1]:
                return due[2]
            self._bus.send(due[2])
        while (message := self._bus.recv(timeout=timeout)) is not None:
            if bytes(message.data) in self._others and not message.is_rx:
                self._others.remove(bytes(message.data))
                message.is_rx = True
            ours = self._names.get(message.arbitration_id) == "GripperCommand"
            changed = message if ours else self._changed(message, faults, now_s, sends=False)
            if changed is not None:
                return changed
        return None

    def send(self, message: can.Message) -> None:
        now_s = self._injection.now_s()
        changed = self._changed(message, self._injection.on("bus"), now_s, sends=True)
        if changed is not None:
            self._bus.send(changed)

    def shutdown(self) -> None:
        self._bus.shutdown()

    def _intrude(self, fault: SignalFault, now_s: float) -> None:
        """Now and then a frame that nobody of ours sent; one with a register's value comes once."""
        if fault.kind != "foreign" or fault.signal not in self._names.values():
            return
        if now_s < self._foreign_s.get(fault, now_s):
            return
        message = self._database.get_message_by_name(fault.signal)
        register, sign, value = str(fault.size).partition("=")
        if sign:
            values = {signal.name: float(value) if signal.name == register else 0.0 for signal in message.signals}
            data = message.encode(_within(message, values))
        else:
            rng = np.random.default_rng(round(1000 * now_s))
            data = rng.integers(0, 256, message.length, np.uint8).tobytes()
        self._foreign_s[fault] = np.inf if sign else now_s + AGAIN_S
        self._injection.shown = True
        sent = fault.signal == "GripperCommand"
        self._others += [data] * sent
        self._waiting.append((now_s, sent, _message(message.frame_id, data)))

    def _changed(
        self, message: can.Message, faults: Sequence[SignalFault], now_s: float, *, sends: bool
    ) -> can.Message | None:
        """The frame as the faults have it; None for one that is lost, or late."""
        name = self._names.get(message.arbitration_id, "")
        for fault in faults:
            if fault.signal in (name, FRAMES):
                self._injection.shown = True
                if fault.kind in ("lost", "late"):
                    if fault.kind == "late":
                        self._waiting.append((now_s + fault.number, sends, message))
                    return None
                if fault.kind == "repeated":
                    self._waiting.append((now_s, sends, message))
                message = _message(message.arbitration_id, self._frame(fault, bytes(message.data), now_s))
            elif name and fault.signal in self._database.get_message_by_name(name).signal_tree:
                self._injection.shown = True
                message = self._register(fault, message, now_s)
        return message

    @staticmethod
    def _frame(fault: SignalFault, data: bytes, now_s: float) -> bytes:
        if fault.kind == "cut":
            return data[:3]
        if fault.kind == "stuck":
            kept: bytes = fault.apply(data, now_s)
            return kept
        bits = int.from_bytes(data, "little")
        if fault.kind == "flipped":
            bits ^= 1 << (7 * (1 + round(fault.number)) % (8 * len(data)))
        return bits.to_bytes(len(data), "little")

    def _register(self, fault: SignalFault, message: can.Message, now_s: float) -> can.Message:
        known = self._database.get_message_by_frame_id(message.arbitration_id)
        values = dict(known.decode(bytes(message.data), decode_choices=False))
        value = float(values[fault.signal])
        if fault.kind == "flipped":  # the lowest bit of a word, the other end of a measure's range
            signal = known.get_signal_by_name(fault.signal)
            values[fault.signal] = signal.maximum - value if signal.length > 7 else int(value) ^ 1
        else:
            values[fault.signal] = fault.apply(value, now_s)
        return _message(message.arbitration_id, known.encode(_within(known, values)))


def _within(message: Any, values: dict[str, float]) -> dict[str, float]:
    """What the registers can hold."""
    limits = {signal.name: (signal.minimum, signal.maximum, signal.scale == 1) for signal in message.signals}
    kept = {name: min(max(value, limits[name][0]), limits[name][1]) for name, value in values.items()}
    return {name: round(value) if limits[name][2] else value for name, value in kept.items()}


def _message(identifier: int, data: bytes) -> can.Message:
    return can.Message(arbitration_id=identifier, data=data, is_extended_id=False)
