"""Devices and a CAN bus with a fault: they answer as broken ones would. Nothing of a controller knows of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Protocol

import can
import numpy as np

from cell.errors import DeviceFault
from cell.interfaces.command import JointTrajectory
from cell.interfaces.devices import Arm, Camera
from cell.interfaces.observation import ArmMode, ArmState, JointSamples
from cell.interfaces.perception import Frame

STATUS_ID, HEARTBEAT_ID, EMERGENCY_ID = "GripperStatus", "GripperHeartbeat", "GripperEmergency"
BOOT_UP, PRE_OPERATIONAL, RESET = 0x00, 0x7F, 0
MODES: dict[str, ArmMode] = {
    "arm_protective_stop": "protective_stop",
    "arm_safeguard": "safeguard_stop",
    "arm_emergency": "emergency_stop",
    "arm_reduced": "reduced",
}


UNSEEN = ("arm_refuses", "arm_ignores")  # only the next command shows them


class Fault(Protocol):
    """What a proxy asks.

    Attributes:
        fault: its name.
        active: whether it is there now.
        shown: a device has answered with it.
        first_frame: number of the first frame that it spoiled.
        cleared: somebody has put an end to it.
    """

    fault: str
    shown: bool
    first_frame: int | None
    cleared: bool

    @property
    def active(self) -> bool: ...


class FaultyArm:
    """An arm with a fault."""

    def __init__(self, arm: Arm, injection: Fault) -> None:
        self._arm, self._injection = arm, injection
        self._frozen: ArmState | None = None

    def state(self) -> ArmState:
        state = self._arm.state()
        if not self._injection.active:
            self._frozen = state
            return state
        fault = self._injection.fault
        self._injection.shown |= fault not in UNSEEN
        if fault == "arm_protective_stop" and state.path_s is not None:
            self._arm.stop()  # which forgets its path
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
                self._injection.shown = True
                raise DeviceFault("arm", "refuses the trajectory")
            if self._injection.fault == "arm_ignores":
                self._injection.shown = True
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

    def acknowledge(self) -> None:
        self._injection.cleared |= self._injection.active and self._injection.fault == "arm_protective_stop"
        self._arm.acknowledge()

    def samples(self) -> JointSamples | None:
        return self._arm.samples()

    @property
    def _stands_by_itself(self) -> bool:
        """A real arm stops by itself in these modes."""
        return MODES.get(self._injection.fault) in ("protective_stop", "safeguard_stop", "emergency_stop")


class FaultyCamera:
    """An overhead camera with a fault."""

    def __init__(self, camera: Camera, injection: Fault) -> None:
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
        new = self._last is None or frame.sequence > self._last.sequence
        if fault.startswith("camera") and self._injection.first_frame is None and new:
            self._injection.first_frame = frame.sequence
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

    def __init__(self, bus: can.BusABC, injection: Fault, database: Any) -> None:
        self._bus, self._injection, self._database = bus, injection, database
        self._again: can.Message | None = None
        self._booted = False

    def recv(self, timeout: float | None = None) -> can.Message | None:
        if self._again is not None:
            again, self._again = self._again, None
            return again
        if self._injection.active and self._injection.fault == "bus_off":
            raise can.CanOperationError("bus off")
        while (message := self._bus.recv(timeout=timeout)) is not None:
            changed = self._changed(message) if self._injection.active else message
            if changed is not None:
                return changed
        return None

    def send(self, message: can.Message) -> None:
        if self._injection.active and self._injection.fault == "bus_deaf":
            return
        if self._injection.active and self._injection.fault == "gripper_reboots":
            told = self._database.decode_message(message.arbitration_id, bytes(message.data), decode_choices=False)
            if not told["rACT"]:
                return  # the node does not know it anyway
            values = {**told, "rACT": 0.0, "rGTO": 0.0}
            self._bus.send(self._encoded(message, values))
            self._injection.cleared = True  # activated anew, it is as any other
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
        if fault == "status_twice":
            self._again = message
        if fault == "status_cut" and name == STATUS_ID:
            return can.Message(
                arbitration_id=message.arbitration_id, data=bytes(message.data)[:3], is_extended_id=False
            )
        registers = {
            ("gripper_fault", STATUS_ID): {"gFLT": 0x0E},
            ("gripper_refuses", STATUS_ID): {"gFLT": 0x07},
            ("gripper_stopped", HEARTBEAT_ID): {"NodeState": 0x04},
            ("gripper_reboots", STATUS_ID): {"gACT": 0, "gGTO": 0, "gSTA": RESET, "gOBJ": 0, "gFLT": 0},
            ("gripper_reboots", HEARTBEAT_ID): {"NodeState": PRE_OPERATIONAL if self._booted else BOOT_UP},
            ("gripper_reboots", EMERGENCY_ID): {"ErrorCode": 0, "ErrorRegister": 0, "FaultStatus": 0},
        }
        values = registers.get((fault, name))
        if values is None:
            return message
        self._booted |= fault == "gripper_reboots" and name == HEARTBEAT_ID
        told = self._database.decode_message(message.arbitration_id, bytes(message.data), decode_choices=False)
        return self._encoded(message, {**told, **values})

    def _encoded(self, message: can.Message, values: Mapping[str, float]) -> can.Message:
        data = self._database.encode_message(message.arbitration_id, values)
        return can.Message(arbitration_id=message.arbitration_id, data=data, is_extended_id=False)
