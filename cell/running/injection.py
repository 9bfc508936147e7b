"""Fault injection: one list of faults, put in by proxies around the devices and the CAN bus in a state of the work.

Nothing of a controller knows of it: a proxy answers as a broken device would. Faults that pass end by themselves.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import can
import numpy as np

from cell.interfaces.command import JointTrajectory
from cell.interfaces.devices import Arm, Camera, Devices
from cell.interfaces.errors import DeviceFault, InputError
from cell.interfaces.observation import ArmMode, ArmState, JointSamples
from cell.interfaces.perception import Frame
from cell.observer import Level, Outcome, TickRecord

PASSES_S = 1.5
BEGINS_TICKS = 5  # a state has lasted this long when the fault comes, so that the arm is under way
STATUS_ID, HEARTBEAT_ID, COMMAND_ID = "GripperStatus", "GripperHeartbeat", "GripperCommand"

# By how a skill's note begins.
STATES = {
    "look": "moving to look",
    "above": "moving above",
    "down": "going down",
    "grasp": "grasping",
    "lift": "lifting",
    "carry": "carrying",
    "lower": "lowering",
    "release": "letting go",
    "leave": "leaving",
    "park": "moving to park",
}
OTHER_STATES = ("idle", "waiting_for_help")


@dataclass(frozen=True)
class FaultKind:
    """One fault.

    Attributes:
        what: in words.
        passes: it goes away by itself after PASSES_S.
        ends: how a run may end with it, by names of `Outcome.end`: what the table of faults promises.
    """

    what: str
    passes: bool
    ends: tuple[str, ...]


def _stops(what: str) -> FaultKind:
    return FaultKind(what, False, ("fault",))


def _recovers(what: str) -> FaultKind:
    return FaultKind(what, True, ("finished",))


FAULTS: dict[str, FaultKind] = {
    "arm_frozen": _stops("the arm's state does not change any more, its time stamp neither"),
    "arm_nan": _stops("the arm's joints are not numbers"),
    "arm_velocity_nan": _stops("one joint's speed is not a number"),
    "arm_five_joints": _stops("the arm tells five joints"),
    "arm_offset": FaultKind("the arm tells its base joint 0.03 rad off", False, ("fault", "finished")),
    "arm_lost": _stops("reading the arm raises"),
    "arm_deaf": _stops("reading and commanding the arm raise"),
    "arm_refuses": FaultKind("the arm refuses trajectories", False, ("fault", "finished")),
    "arm_ignores": FaultKind("the arm ignores trajectories", False, ("fault", "finished")),
    "arm_protective_stop": FaultKind("protective stop, acknowledged", True, ("finished", "failed")),
    "arm_safeguard": _recovers("the safeguard opens and closes"),
    "arm_emergency": _stops("an emergency stop is pressed"),
    "arm_reduced": _recovers("reduced mode for a while"),
    "heartbeat_lost": _stops("no heartbeat of the gripper"),
    "status_lost": _stops("no status of the gripper, although its heartbeat comes"),
    "status_gap": _recovers("no status of the gripper for 0.4 s"),
    "bus_silent": _stops("nothing comes over the bus"),
    "bus_off": _stops("reading the bus raises"),
    "bus_deaf": _stops("what is sent is lost"),
    "gripper_fault": _stops("gFLT 0x0E, overcurrent"),
    "gripper_refuses": _stops("gFLT 7, not activated"),
    "gripper_stopped": _stops("the gripper's node says that it is stopped"),
    "camera_dead": _recovers("the overhead camera sends nothing for a while"),
    "camera_raises": _recovers("the overhead camera raises for a while"),
    "camera_frozen": _recovers("the same image with new numbers and stamps for a while"),
    "camera_black": _recovers("black images for a while"),
    "camera_swapped": _recovers("red and blue swapped for a while"),
    "camera_future": _recovers("stamps of the future for a while"),
    "sigint": FaultKind("SIGINT", False, ("interrupted",)),
    "sigterm_twice": FaultKind("SIGTERM, twice", False, ("interrupted",)),
    "sighup": FaultKind("SIGHUP", False, ("interrupted",)),
    "observer_raises": FaultKind("an observer raises in every tick", False, ("finished",)),
}


class Injection:
    """One fault in one state; also an observer, which sees the states come.

    Attributes:
        began_s: when the fault came; None before.
    """

    def __init__(self, fault: str, state: str) -> None:
        """Args:
        fault: a name of FAULTS.
        state: a name of STATES, or of OTHER_STATES.

        Raises:
            InputError: there is none of that name.
        """
        if fault not in FAULTS:
            raise InputError(f"unknown fault {fault!r}; legal: {', '.join(FAULTS)}")
        if state not in (*STATES, *OTHER_STATES):
            raise InputError(f"unknown state {state!r}; legal: {', '.join((*STATES, *OTHER_STATES))}")
        self.fault, self.state = fault, state
        self.began_s: float | None = None
        self._now = "idle"
        self._ticks_in = 0
        self._clock: Callable[[], float] = lambda: 0.0

    @classmethod
    def parse(cls, text: str) -> Injection:
        """Of the option `--inject FAULT@STATE`."""
        fault, _, state = text.partition("@")
        return cls(fault, state or "carry")

    @property
    def active(self) -> bool:
        """Whether the fault is there now."""
        if self.began_s is None:
            return False
        lasts_s = 0.4 if self.fault == "status_gap" else PASSES_S
        return not FAULTS[self.fault].passes or self._clock() - self.began_s < lasts_s

    def devices(self, devices: Devices) -> Devices:
        """The same devices with proxies."""
        self._clock = devices.clock.now_s
        overhead = FaultyCamera(devices.overhead, self) if self.fault.startswith("camera") else devices.overhead
        arm = FaultyArm(devices.arm, self) if self.fault.startswith("arm") else devices.arm
        return replace(devices, arm=arm, overhead=overhead)

    def bus(self, bus: can.BusABC, database: Any) -> can.BusABC:
        """The same bus with a proxy."""
        faulty: Any = FaultyBus(bus, self, database)
        return faulty  # type: ignore[no-any-return]

    def frame(self, frame: Frame) -> None:
        """Images are not looked at."""

    def tick(self, record: TickRecord) -> None:
        """See in which state the work is; at the wanted one the fault comes."""
        before = self._now
        for topic, fields in record.notes:
            if topic == "help":
                self._now = "waiting_for_help"
            elif topic == "skill":
                reason = str(fields.get("reason", ""))
                self._now = next((name for name, start in STATES.items() if reason.startswith(start)), "idle")
        self._ticks_in = self._ticks_in + 1 if self._now == before else 0
        if self.began_s is None and self._now == self.state and self._ticks_in >= BEGINS_TICKS:
            self.began_s = record.observation.time_s
            self._signal()
        if self.fault == "observer_raises" and self.active:
            raise OSError(28, "No space left on device")

    def message(self, time_s: float, level: Level, text: str) -> None:
        """Nothing to do."""

    def close(self, outcome: Outcome) -> None:
        """Nothing to do."""

    def _signal(self) -> None:
        numbers = {"sigint": [signal.SIGINT], "sigterm_twice": [signal.SIGTERM] * 2, "sighup": [signal.SIGHUP]}
        for number in numbers.get(self.fault, []):
            os.kill(os.getpid(), number)


class FaultyArm:
    """An arm with a fault."""

    def __init__(self, arm: Arm, injection: Injection) -> None:
        self._arm, self._injection = arm, injection
        self._frozen: ArmState | None = None

    def state(self) -> ArmState:
        state = self._arm.state()
        if not self._injection.active:
            self._frozen = state
            return state
        fault = self._injection.fault
        if fault in ("arm_lost", "arm_deaf"):
            raise DeviceFault("arm", "connection lost")
        if fault == "arm_frozen":
            return self._frozen or state
        if fault == "arm_nan":
            return replace(state, positions_rad=(float("nan"),) * 6)
        if fault == "arm_velocity_nan":
            return replace(state, velocities_rad_s=(*state.velocities_rad_s[:3], float("nan"), 0.0, 0.0))
        if fault == "arm_five_joints":
            return replace(state, positions_rad=state.positions_rad[:5])
        if fault == "arm_offset":
            return replace(state, positions_rad=(state.positions_rad[0] + 0.03, *state.positions_rad[1:]))
        if (mode := MODES.get(fault)) is not None:
            return replace(state, mode=mode)
        return state

    def follow(self, trajectory: JointTrajectory) -> JointTrajectory:
        if self._injection.active:
            if self._injection.fault in ("arm_refuses", "arm_deaf") or self._stands_by_itself:
                raise DeviceFault("arm", "refuses the trajectory")
            if self._injection.fault == "arm_ignores":
                return trajectory
        return self._arm.follow(trajectory)

    def stop(self) -> None:
        if self._injection.active and self._injection.fault == "arm_deaf":
            raise DeviceFault("arm", "connection lost")
        self._arm.stop()

    def pace(self, share: float) -> None:
        if self._injection.active and self._injection.fault == "arm_deaf":
            raise DeviceFault("arm", "connection lost")
        self._arm.pace(0.0 if self._injection.active and self._stands_by_itself else share)

    def samples(self) -> JointSamples | None:
        return self._arm.samples()

    @property
    def _stands_by_itself(self) -> bool:
        """A real arm stops by itself in these modes."""
        return MODES.get(self._injection.fault) in ("protective_stop", "safeguard_stop", "emergency_stop")


MODES: dict[str, ArmMode] = {
    "arm_protective_stop": "protective_stop",
    "arm_safeguard": "safeguard_stop",
    "arm_emergency": "emergency_stop",
    "arm_reduced": "reduced",
}


class FaultyCamera:
    """An overhead camera with a fault."""

    def __init__(self, camera: Camera, injection: Injection) -> None:
        self._camera, self._injection = camera, injection
        self._last: Frame | None = None

    def trigger(self) -> None:
        self._camera.trigger()

    def latest(self) -> Frame | None:
        frame = self._camera.latest()
        if frame is None or not self._injection.active:
            self._last = frame
            return frame
        fault = self._injection.fault
        if fault == "camera_raises":
            raise OSError(19, "No such device")
        if fault == "camera_dead" or self._last is None:
            return self._last
        if fault == "camera_future":
            return Frame(frame.camera, frame.sequence, frame.time_s + 1000.0, frame.image, frame.world_from_camera)
        image = frame.image
        if fault == "camera_frozen":
            image = self._last.image
        elif fault == "camera_black":
            image = np.zeros_like(image)
        elif fault == "camera_swapped":
            image = np.ascontiguousarray(image[..., ::-1])
        return Frame(frame.camera, frame.sequence, frame.time_s, image, frame.world_from_camera)


class FaultyBus:
    """A CAN bus with a fault; frames of the gripper are lost or changed."""

    def __init__(self, bus: can.BusABC, injection: Injection, database: Any) -> None:
        self._bus, self._injection, self._database = bus, injection, database

    def recv(self, timeout: float | None = None) -> can.Message | None:
        if self._injection.active and self._injection.fault == "bus_off":
            raise can.CanOperationError("bus off")
        while (message := self._bus.recv(timeout=timeout)) is not None:
            changed = self._changed(message) if self._injection.active else message
            if changed is not None:
                return changed
        return None

    def send(self, message: can.Message) -> None:
        if not (self._injection.active and self._injection.fault == "bus_deaf"):
            self._bus.send(message)

    def shutdown(self) -> None:
        self._bus.shutdown()

    def _changed(self, message: can.Message) -> can.Message | None:
        """The frame as the fault has it; None for a lost one."""
        fault = self._injection.fault
        name = next((one.name for one in self._database.messages if one.frame_id == message.arbitration_id), "")
        lost = {"heartbeat_lost": (HEARTBEAT_ID,), "status_lost": (STATUS_ID,), "status_gap": (STATUS_ID,)}
        if fault == "bus_silent" or name in lost.get(fault, ()):
            return None
        registers = {
            ("gripper_fault", STATUS_ID): {"gFLT": 0x0E},
            ("gripper_refuses", STATUS_ID): {"gFLT": 0x07},
            ("gripper_stopped", HEARTBEAT_ID): {"NodeState": 0x04},
        }
        values = registers.get((fault, name))
        if values is None:
            return message
        told = self._database.decode_message(message.arbitration_id, bytes(message.data), decode_choices=False)
        data = self._database.encode_message(message.arbitration_id, {**told, **values})
        return can.Message(arbitration_id=message.arbitration_id, data=data, is_extended_id=False)
