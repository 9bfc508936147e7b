"""Reads every device once a tick into an Observation; what a device raises becomes part of it, never control flow."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import TypeVar

import numpy as np

from bracket_cell.remote.worker import NotAnswering
from bracket_cell.running.inference import Executor
from bracket_cell.running.wrist_freshness import WristFreshness
from bracket_cell.skills.motion.arm_outline import ArmOutline
from bracket_cell.skills.motion.collision import HELD
from bracket_ground.errors import CellError, DeviceFault, LatchedFault
from bracket_ground.interfaces.devices import Camera, Devices
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.observation import (
    STALE_ARM_S,
    ArmState,
    GripperState,
    JointSamples,
    Observation,
    Trouble,
)
from bracket_ground.interfaces.perception import BenchView, PartsView
from bracket_ground.interfaces.pose import Array, Pose

KEPT = 12  # states of the arm: half a second
NEAR_S = 0.1  # a state that is farther in time from a frame tells nothing of it


class RobotPoseHistory:
    """Remembers the arm's last states, and what it measured between them.

    Args:
        forward: world_from_tool of joints (n,).
    """

    def __init__(self, outline: ArmOutline, forward: Callable[[Array], Pose]) -> None:
        self._outline, self._forward = outline, forward
        self._samples: deque[JointSamples] = deque(maxlen=KEPT)
        self._part = np.array([name == HELD for name in outline.names])
        self._states: deque[tuple[float, tuple[float, ...], bool]] = deque(maxlen=KEPT)

    def keep(self, arm: ArmState, gripper: GripperState) -> None:
        """One more state as measured."""
        joints = arm.known_rad(self._outline.joints)
        if joints is not None and (not self._states or arm.time_s > self._states[-1][0]):
            self._states.append((arm.time_s, joints, gripper.holding))

    def sampled(self, samples: JointSamples) -> None:
        """What was measured between the last states; it is left out where it is not finite, or goes back in time."""
        rows = np.column_stack([samples.times_s, samples.positions_rad])
        if np.isfinite(rows).all() and (np.diff(rows[:, 0]) > 0).all():
            self._samples.append(samples)

    def tool_at(self, time_s: float) -> Pose | None:
        """world_from_tool at a time, between measurements; None where the arm was not measured about then."""
        states = [state for state in self._states if not self._samples or state[0] > self._samples[-1].times_s[-1]]
        times_s = np.concatenate(
            [*(sample.times_s for sample in self._samples), np.array([state[0] for state in states])]
        )
        with np.errstate(over="ignore"):  # times of a mad clock are far, however far
            near = len(times_s) and np.abs(times_s - time_s).min() <= NEAR_S
        if not near:
            return None
        joints = np.concatenate(
            [*(sample.positions_rad for sample in self._samples), *([state[1]] for state in states)]
        )
        between = np.array([np.interp(time_s, times_s, column) for column in joints.T])
        return self._forward(between) if np.isfinite(between).all() else None

    def at(self, time_s: float) -> Array | None:
        """Points around the links at a time, see `Frame.robot_m`; None where the arm was not measured about then.

        The points are those of the last state before and of the first one after, so their hull holds what is between.
        """
        before = [state for state in self._states if state[0] <= time_s][-1:]
        after = [state for state in self._states if state[0] > time_s][:1]
        near = [state for state in (*before, *after) if abs(state[0] - time_s) <= NEAR_S]
        if not near:
            return None
        placed = self._outline.placed(np.array([joints for _, joints, _ in near]))
        points: Array = np.concatenate(list(self._outline.corners_m(placed)), axis=1)
        held = any(holding for _, _, holding in near)
        return points if held else points[~self._part]


Value = TypeVar("Value")


class CameraReader:
    """A camera and the detector that reads its frames; keeps the newest frame's number.

    Attributes:
        in_time: its detector took the last frame.
    """

    def __init__(self, camera: Camera) -> None:
        self.camera, self.in_time = camera, True
        self._sequence = -1
        self._time_s = float("-inf")

    def new_frame(self) -> Frame | None:
        """The camera's newest frame if it was not handed out before.

        A camera that was plugged in again counts from 0: then the later time stamp tells that the frame is new.
        """
        frame = self.camera.latest()
        if frame is None or (frame.sequence <= self._sequence and frame.time_s <= self._time_s):
            return None
        self._sequence, self._time_s = frame.sequence, frame.time_s
        return frame


class DeviceReader:
    """What the loop sees of the cell.

    Args:
        framed: called with every new camera frame.
        say: called for frames that a detector had no time for.
        own_body: tells the detector of overhead frames where the robot is.
    """

    def __init__(
        self,
        devices: Devices,
        watcher: Executor[Frame, BenchView],
        finder: Executor[Frame, PartsView],
        framed: Callable[[Frame], None],
        say: Callable[[str], None],
        own_body: RobotPoseHistory | None = None,
    ) -> None:
        self._signals, self._own_body = devices.signals, own_body
        self._devices, self._gripper = devices, devices.gripper
        self._watcher, self._finder = watcher, finder
        self._framed, self._say = framed, say
        self._overhead, self._wrist = CameraReader(devices.overhead), CameraReader(devices.wrist)
        self._freshness = WristFreshness()
        self._arm: ArmState | None = None
        self._fingers: GripperState | None = None
        self._bench: BenchView | None = None
        self._parts: PartsView | None = None
        self._troubles: list[Trouble] = []

    def refused(self, device: str, error: Exception) -> None:
        """A device raised when it was commanded: the next observation tells."""
        self._troubles.append(Trouble(device, describe(error)))

    def observe(self, tick: int) -> Observation:
        """Read every device once.

        Raises:
            DeviceFault: arm or gripper cannot be read and never could.
        """
        self._arm = self._read("arm", self._devices.arm.state) or self._arm
        self._fingers = self._read("gripper", self._gripper.state) or self._fingers
        if self._own_body is not None and self._arm is not None and self._fingers is not None:
            self._own_body.keep(self._arm, self._fingers)
            self._freshness.see(self._fingers, self._own_body.tool_at(self._arm.time_s), self._parts)
        self._detect(self._overhead, self._watcher, "overhead")
        self._detect(self._wrist, self._finder, "wrist")
        self._bench = self._read("detector overhead", self._watcher.poll) or self._bench
        self._parts = self._read("detector wrist", self._finder.poll) or self._parts
        signals = self._read("signals", self._signals.read) if self._signals is not None else None
        troubles, self._troubles = tuple(self._troubles), []
        if self._arm is None or self._fingers is None:
            reasons = "; ".join(trouble.reason for trouble in troubles)
            raise DeviceFault("devices", reasons or "a device reported nothing")
        return Observation(
            tick=tick,
            time_s=self._devices.clock.now_s(),
            arm=self._arm,
            gripper=self._fingers,
            bench=self._bench,
            parts=self._parts,
            troubles=troubles,
            signals=signals or {},
        )

    def samples(self) -> JointSamples | None:
        """What the arm measured since the last call; None where it cannot be asked."""
        samples = self._read("arm", self._devices.arm.samples)
        if samples is not None and len(samples.times_s) and self._own_body is not None:
            self._own_body.sampled(samples)
        return samples

    def _detect(self, reader: CameraReader, executor: Executor[Frame, object], name: str) -> None:
        frame = self._read(f"camera {name}", lambda: self._placed(reader.new_frame()))
        if frame is None:
            return
        self._framed(frame)
        if self._own_body is not None and reader is self._overhead:
            frame = frame.beside(self._own_body.at(frame.time_s))
        if reader is self._wrist and not self._read("camera wrist", lambda: self._freshness.check(frame)):
            return
        taken = self._read(f"detector {name}", lambda: executor.submit(frame))
        if taken is False and reader.in_time:
            self._say(f"the detector of camera {name} is late: frames are dropped")
        reader.in_time = taken is not False

    def _placed(self, frame: Frame | None) -> Frame | None:
        """A frame with where its camera was.

        Raises:
            DeviceFault: it is at the tool, and the arm was not measured then.
        """
        if frame is None or not frame.at_tool:
            return frame
        tool = None if self._own_body is None else self._own_body.tool_at(frame.time_s)
        if tool is None and self._arm is not None and self._devices.clock.now_s() - self._arm.time_s > STALE_ARM_S:
            return None  # the arm is silent, which is told of the arm
        if tool is None:
            raise DeviceFault(f"camera {frame.camera}", "the arm was not measured when its frame was taken")
        return frame.seen_from(tool @ frame.world_from_camera)

    def _read(self, device: str, read: Callable[[], Value]) -> Value | None:
        try:
            return read()
        except NotAnswering as error:  # a detector that may go on: nothing is seen by its camera meanwhile
            self._troubles.append(Trouble(device.replace("detector", "camera"), describe(error)))
            return None
        except Exception as error:  # whatever a driver raises: the supervisor decides what it means
            latched = " fault" * isinstance(error, LatchedFault)
            self._troubles.append(Trouble(f"{device}{latched}", describe(error)))
            return None


def describe(error: BaseException) -> str:
    """One line about an error: our own in their words, others with type and notes; never raises itself."""
    try:
        if isinstance(error, CellError):
            return str(error)
        if isinstance(error, ExceptionGroup):
            return "; ".join(map(describe, error.exceptions))
        return ", ".join([f"{type(error).__name__}: {error}", *getattr(error, "__notes__", ())])
    except Exception:  # an exception whose words raise
        return type(error).__name__
