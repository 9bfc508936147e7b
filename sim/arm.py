"""The simulated UR10: follows joint trajectories at its 125 Hz cycle through position servos."""

from __future__ import annotations

import numpy as np

from cell.interfaces.bench import JOINTS
from cell.interfaces.command import JointTrajectory
from cell.interfaces.errors import DeviceFault
from cell.interfaces.observation import ArmState, JointSamples
from cell.interfaces.pose import Array
from sim.world import World

POSITION_LIMITS_RAD = np.array([2 * np.pi, 2 * np.pi, np.pi, 2 * np.pi, 2 * np.pi, 2 * np.pi])
SPEED_LIMITS_RAD_S = np.radians([120.0, 120.0, 180.0, 180.0, 180.0, 180.0])
SPEED_TOLERANCE = 1.02  # sampled trajectories overshoot a little between their samples
STOP_DECELERATION_RAD_S2 = 6.0
START_TOLERANCE_RAD = 0.05
TRACKING_LIMIT_RAD = 0.10
TRACKING_PERIODS = 5
KEPT_SAMPLES = 4096  # for as long as nobody takes them; the oldest give way


class SimArm:
    """Implements `Arm` on the simulated joints.

    Attributes:
        driven_rad_s: how fast the servos' set points move, (6,); what pushes the arm besides is not in it.
    """

    def __init__(self, world: World) -> None:
        self._world = world
        self._period_s = world.physics.control_period_s
        model = world.model
        stiffness = model.actuator_gainprm[world.arm_ctrl, 0]
        damping = -model.actuator_biasprm[world.arm_ctrl, 2] + model.dof_damping[world.arm_qvel]
        self._lag_s = damping / stiffness  # a servo trails a moving set point by this much time
        self._reference = self._positions()[np.newaxis]
        self._cursor = 0
        self._time_s = 0.0
        self._late_periods = 0
        self._fault: str | None = None
        self._joints = len(world.arm_qpos)
        self._samples = np.empty((KEPT_SAMPLES, 1 + 3 * self._joints))
        self._sampled = 0
        self.driven_rad_s: Array = np.zeros(self._joints)

    def state(self) -> ArmState:
        """Joints as measured; raises DeviceFault after a protective stop."""
        if self._fault is not None:
            raise DeviceFault("arm", self._fault)
        velocities = self._world.data.qvel[self._world.arm_qvel]
        return ArmState(
            self._time_s,
            tuple(float(value) for value in self._positions()),
            tuple(float(value) for value in velocities),
            self._moving,
        )

    def follow(self, trajectory: JointTrajectory) -> JointTrajectory:
        """Start now; raises DeviceFault where the arm cannot or must not follow."""
        self._refuse_bad(trajectory)
        count = int(np.ceil(trajectory.duration_s / self._period_s - 1e-9))
        times = np.arange(count + 1) * self._period_s
        columns = [np.interp(times, trajectory.times_s, column) for column in trajectory.positions_rad.T]
        self._reference, self._cursor = np.column_stack(columns), 0
        return trajectory

    def stop(self) -> None:
        """Slow down along the path that is being followed, so that what was checked for collisions stays true."""
        if not self._moving:
            return
        ahead = self._reference[self._cursor :]
        speed = np.abs(ahead[1] - ahead[0]).max() / self._period_s
        count = max(1, int(np.ceil(speed / STOP_DECELERATION_RAD_S2 / self._period_s)))
        rates = 1.0 - (np.arange(count) + 0.5) / count
        progress = np.concatenate([[0.0], np.cumsum(rates)])
        samples = np.arange(len(ahead), dtype=np.float64)
        self._reference = np.column_stack([np.interp(progress, samples, column) for column in ahead.T])
        self._cursor = 0

    def observe(self, time_s: float, /) -> None:
        """Measure the joints."""
        data, world, joints = self._world.data, self._world, self._joints
        row = self._samples[self._sampled % KEPT_SAMPLES]
        row[0] = time_s
        row[1 : 1 + joints] = data.qpos[world.arm_qpos]
        row[1 + joints : 1 + 2 * joints] = data.qvel[world.arm_qvel]
        row[1 + 2 * joints :] = data.qfrc_actuator[world.arm_qvel]
        self._sampled += 1

    def samples(self) -> JointSamples:
        """What was measured since the last call."""
        count, self._sampled = self._sampled, 0
        rows = self._samples[:count].copy() if count <= KEPT_SAMPLES else np.roll(self._samples, -count, axis=0)
        return JointSamples(rows[:, 0], *np.split(rows[:, 1:], 3, axis=1))

    def update(self, time_s: float, dt_s: float) -> None:
        """Set the servos for one control period."""
        self._watch_tracking()
        here = self._reference[self._cursor]
        if self._moving:
            self._cursor += 1
        there = self._reference[self._cursor]
        self.driven_rad_s = velocity = (there - here) / dt_s
        self._world.data.ctrl[self._world.arm_ctrl] = (here + there) / 2 + velocity * self._lag_s
        self._time_s = time_s + dt_s

    @property
    def tracking_error_rad(self) -> float:
        """Widest distance of a joint from its reference."""
        return float(np.abs(self._positions() - self._reference[self._cursor]).max())

    @property
    def _moving(self) -> bool:
        return self._cursor < len(self._reference) - 1

    def _positions(self) -> Array:
        positions: Array = self._world.data.qpos[self._world.arm_qpos].copy()
        return positions

    def _watch_tracking(self) -> None:
        """Protective stop: hold still once the arm is held back from its reference."""
        self._late_periods = self._late_periods + 1 if self.tracking_error_rad > TRACKING_LIMIT_RAD else 0
        if self._late_periods >= TRACKING_PERIODS and self._fault is None:
            error = np.abs(self._positions() - self._reference[self._cursor])
            self._fault = (
                f"protective stop: {JOINTS[int(error.argmax())]} is {error.max():.3f} rad from its trajectory, "
                f"limit {TRACKING_LIMIT_RAD} rad"
            )
            self._reference, self._cursor = self._positions()[np.newaxis], 0

    def _refuse_bad(self, trajectory: JointTrajectory) -> None:
        if self._fault is not None:
            raise DeviceFault("arm", self._fault)
        positions = trajectory.positions_rad
        if not (np.isfinite(positions).all() and np.isfinite(trajectory.times_s).all()):
            raise DeviceFault("arm", "trajectory holds values that are not finite")
        jump = np.abs(positions[0] - self._positions())
        if jump.max() > START_TOLERANCE_RAD:
            raise DeviceFault(
                "arm",
                f"trajectory starts {jump.max():.3f} rad from where {JOINTS[int(jump.argmax())]} is, "
                f"limit {START_TOLERANCE_RAD} rad",
            )
        beyond = (np.abs(positions) - POSITION_LIMITS_RAD).max(axis=0)
        if beyond.max() > 0:
            joint = int(beyond.argmax())
            raise DeviceFault(
                "arm", f"trajectory leaves the range of {JOINTS[joint]}, +-{POSITION_LIMITS_RAD[joint]:.3f} rad"
            )
        self._refuse_fast(trajectory)

    def _refuse_fast(self, trajectory: JointTrajectory) -> None:
        steps_s = np.diff(trajectory.times_s)
        if (steps_s <= 0).any():
            raise DeviceFault("arm", "trajectory's times do not increase")
        if not len(steps_s):
            return
        speeds = (np.abs(np.diff(trajectory.positions_rad, axis=0)) / steps_s[:, np.newaxis]).max(axis=0)
        excess = speeds / SPEED_LIMITS_RAD_S
        if excess.max() > SPEED_TOLERANCE:
            joint = int(excess.argmax())
            raise DeviceFault(
                "arm",
                f"trajectory moves {JOINTS[joint]} at {speeds[joint]:.2f} rad/s, "
                f"limit {SPEED_LIMITS_RAD_S[joint]:.2f} rad/s",
            )
