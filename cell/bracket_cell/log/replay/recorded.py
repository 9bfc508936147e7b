"""Devices that tell what a log holds of them, from its beginning on."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

from bracket_cell.log.read.frames import Frames
from bracket_cell.log.read.reader import Log, read_log
from bracket_cell.recording.joint_samples import TOPIC, decode
from bracket_cell.skills.drivers.settings import RecordedSettings
from bracket_ground.errors import DeviceFault, LogError
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.clock import Clock
from bracket_ground.interfaces.command import GripperCommand, JointTrajectory
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.observation import ArmState, GripperState, JointSamples, Observation

AFTER_S = 0.2  # the last entry of a log is that of now for so long


@lru_cache(maxsize=2)  # several devices of one log
def _log(path: Path) -> Log:
    return read_log(path)


class _Recorded:
    """A log whose time began when the device was opened.

    Raises:
        LogError: the log cannot be read.
    """

    Settings = RecordedSettings

    def __init__(self, settings: RecordedSettings, clock: Clock, role: str) -> None:
        self._log, self._clock, self._role = _log(settings.log), clock, role
        if not self._log.ticks:
            raise DeviceFault(role, f"{settings.log} holds no tick")
        self._later_s = clock.now_s() - self._log.ticks[0].time_s

    def close(self) -> None:
        """Nothing is open."""

    def _now_s(self) -> float:
        """Time in the log.

        Raises:
            DeviceFault: it is over.
        """
        now_s, last_s = self._clock.now_s() - self._later_s, self._log.ticks[-1].time_s
        if now_s > last_s + AFTER_S:
            raise DeviceFault(self._role, f"the log is over after {last_s:.1f} s")
        return now_s

    def _seen(self) -> Observation:
        number = bisect_right(self._log.ticks, self._now_s(), key=lambda tick: tick.time_s)
        return self._log.ticks[max(0, number - 1)].observation


class RecordedArm(_Recorded):
    """Implements `Arm`: moves as it did, and can be told nothing."""

    def __init__(self, settings: RecordedSettings, clock: Clock, role: str = "arm") -> None:
        super().__init__(settings, clock, role)
        self._samples = [message for message in self._log.messages if message.topic == TOPIC]

    def state(self) -> ArmState:
        """As it was."""
        arm = self._seen().arm
        return replace(arm, time_s=arm.time_s + self._later_s)

    def follow(self, _: JointTrajectory) -> JointTrajectory:
        """Raises DeviceFault: it moves as it did."""
        raise DeviceFault("arm", "a recorded arm follows nothing")

    def stop(self) -> None:
        """Nothing happens."""

    def pace(self, share: float) -> None:
        """Nothing happens."""

    def acknowledge(self) -> None:
        """Nothing happens."""

    def samples(self) -> JointSamples | None:
        """What was measured since the last call, as far as it was logged."""
        count = bisect_right(self._samples, round(self._now_s() * 1e9), key=lambda message: message.time_ns)
        found, self._samples = [decode(sample.data) for sample in self._samples[:count]], self._samples[count:]
        if not found:
            return None
        times_s = np.concatenate([joint_samples.times_s for joint_samples in found]) + self._later_s
        names = ("positions_rad", "velocities_rad_s", "efforts_nm")
        return JointSamples(
            times_s, *(np.concatenate([getattr(joint_samples, name) for joint_samples in found]) for name in names)
        )


class RecordedGripper(_Recorded):
    """Implements `Gripper`, likewise."""

    def __init__(self, settings: RecordedSettings, clock: Clock, role: str = "gripper") -> None:
        super().__init__(settings, clock, role)

    def state(self) -> GripperState:
        """As it was."""
        gripper = self._seen().gripper
        return replace(gripper, time_s=gripper.time_s + self._later_s)

    def activate(self) -> None:
        """Raises DeviceFault, as `command`."""
        raise DeviceFault("gripper", "a recorded gripper takes no command")

    def command(self, _: GripperCommand) -> GripperCommand:
        """Raises DeviceFault: it moves as it did."""
        raise DeviceFault("gripper", "a recorded gripper takes no command")

    def hold(self) -> None:
        """Nothing happens."""


class RecordedCamera(_Recorded):
    """Implements `Camera` by the log's images."""

    def __init__(self, settings: RecordedSettings, clock: Clock, bench: Bench, role: str) -> None:
        super().__init__(settings, clock, role)
        self._mount = getattr(bench, role).drawn.mount.pose
        self._frames, self._sequence = Frames(self._log), -1
        self._times_s = self._frames.times_s(role)
        if not self._times_s:
            raise DeviceFault(f"camera {role}", f"{settings.log} holds no images of it")
        self._newest: Frame | None = None

    def trigger(self) -> None:
        """Nothing happens: frames come as they came."""

    def latest(self) -> Frame | None:
        """The newest image of this time."""
        number = bisect_right(self._times_s, self._now_s()) - 1
        if number != self._sequence and number >= 0:
            self._sequence, time_s = number, self._times_s[number]
            logged = self._frames.at(self._role, time_s)
            assert logged is not None
            try:
                image = np.asarray(cv2.cvtColor(logged.image(), cv2.COLOR_BGR2RGB), np.uint8)
            except LogError as error:
                raise DeviceFault(f"camera {self._role}", str(error)) from None
            at_tool, then_s = self._role == "wrist", time_s + self._later_s
            self._newest = Frame(self._role, number, then_s, image, self._mount, at_tool=at_tool)
        return self._newest
