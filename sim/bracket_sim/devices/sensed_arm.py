"""A simulated arm as its controller meets it: noisy joints, and commands that take their time."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace

import numpy as np

from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.command import JointTrajectory
from bracket_ground.interfaces.observation import ArmState, JointSamples
from bracket_ground.interfaces.pose import Array
from bracket_sim.devices.arm import SimArm
from bracket_sim.scene.settings import Hardware

NOISE_ROWS = 4096  # drawn once; each measurement takes the next row


class SensedArm:
    """Implements `Arm` around a SimArm.

    Args:
        rng: this arm's alone.
    """

    def __init__(self, arm: SimArm, hardware: Hardware, period_s: float, rng: np.random.Generator) -> None:
        self._arm = arm
        size = NOISE_ROWS, len(arm.driven_rad_s)
        self._position_noise = rng.normal(0.0, hardware.joint_noise_rad, size)
        self._speed_noise = rng.normal(0.0, hardware.joint_speed_noise_rad_s, size)
        self._measured = 0
        self._state: ArmState | None = None
        self._latency_periods = math.ceil(hardware.command_latency_s / period_s - 1e-9)
        self._coming: list[tuple[int, Callable[[], object]]] = []
        self._followed = 0  # trajectories under way to the arm
        self._period = 0
        self._paths_s: deque[float | None] = deque(maxlen=1 + round(hardware.trailing_s / period_s))

    def state(self) -> ArmState:
        """Joints as measured in this control period; a trajectory on its way counts as followed."""
        true = self._arm.state()
        if self._state is None or self._state.time_s != true.time_s:
            noise, speed_noise = self._noise(1)
            positions = tuple(float(value) for value in np.array(true.positions_rad) + noise[0])
            speeds = tuple(float(value) for value in np.array(true.velocities_rad_s) + speed_noise[0])
            self._state = replace(true, positions_rad=positions, velocities_rad_s=speeds)
        if not self._followed:
            path_s = (
                self._paths_s[0] if self._paths_s else true.path_s
            )  # of where the joints are, behind the set points
            return replace(self._state, moving=true.moving, path_s=path_s, mode=true.mode, reason=true.reason)
        return replace(self._state, moving=True, path_s=0.0, mode=true.mode, reason=true.reason)

    def follow(self, trajectory: JointTrajectory) -> JointTrajectory:
        """Send it; raises DeviceFault where the arm cannot or must not follow."""
        self._arm.refuse_stopped()
        self._followed += 1

        def begin() -> None:
            self._followed -= 1
            self._paths_s.clear()
            with suppress(DeviceFault):  # it has stopped meanwhile, and its mode tells so
                self._arm.follow(trajectory)

        self._send(begin)
        return trajectory

    def stop(self) -> None:
        """Send the order to stop."""
        self._send(self._arm.stop)

    def pace(self, share: float) -> None:
        """Send the share of speed."""
        self._send(lambda: self._arm.pace(share))

    def acknowledge(self) -> None:
        """Send that somebody unlocked the protective stop."""
        self._send(self._arm.acknowledge)

    def samples(self) -> JointSamples:
        """What was measured since the last call."""
        true = self._arm.samples()
        noise, speed_noise = self._noise(len(true.times_s))
        return replace(
            true, positions_rad=true.positions_rad + noise, velocities_rad_s=true.velocities_rad_s + speed_noise
        )

    def update(self, time_s: float, dt_s: float) -> None:
        """Let commands arrive, in the order in which they were sent, and move the arm by a control period."""
        while self._coming and self._coming[0][0] <= self._period:
            self._coming.pop(0)[1]()
        self._period += 1
        self._arm.update(time_s, dt_s)
        self._paths_s.append(self._arm.path_s)

    def _send(self, act: Callable[[], object]) -> None:
        if self._latency_periods == 0:
            act()
        else:
            self._coming.append((self._period + self._latency_periods, act))

    def _noise(self, count: int) -> tuple[Array, Array]:
        """The next rows of noise for positions and speeds, (count, n) each."""
        rows = np.arange(self._measured, self._measured + count) % NOISE_ROWS
        self._measured += count
        return self._position_noise[rows], self._speed_noise[rows]
