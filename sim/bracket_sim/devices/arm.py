"""The simulated arm: follows joint trajectories in cycles of its control through position servos."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.command import JointTrajectory
from bracket_ground.interfaces.devices import KEEP_ALIVE_S
from bracket_ground.interfaces.observation import ArmState, JointSamples
from bracket_ground.interfaces.paced_path import PacedPath
from bracket_ground.interfaces.pose import Array
from bracket_sim.scene.world import World

TRACKING_LIMIT_RAD = 0.10
TRACKING_PERIODS = 5
FORCE_LIMIT_N = 150.0  # at the tool, as usual safety configurations have it; a bracket's assembly takes below 5 N
SINGULAR = 1e-3  # of the largest singular value: a direction in which the joints feel nothing
FELT_NM = 1.0  # a joint that feels less does not show such a force: the tool's centre would be 7 mm from its axis
FORCE_SHARE = 0.2  # of a new force in that of `ArmState`: a time constant of 5 control periods
KEPT_SAMPLES = 4096  # for as long as nobody takes them; the oldest give way


class SimArm:
    """Implements `Arm` on the simulated joints.

    Attributes:
        driven_rad_s: how fast the servos' set points move, (n,); what pushes the arm besides is not in it.

    Args:
        keep_alive_s: without a call of `pace` for this long the arm stands still on its path; tests may wait for ever.
        trailing_s: how far the joints are behind their set points, as time.
    """

    def __init__(self, world: World, keep_alive_s: float = KEEP_ALIVE_S, trailing_s: float = 0.0) -> None:
        self._world = world
        self._period_s = world.physics.control_period_s
        self._lag_s = servo_lag_s(world) - trailing_s
        self._keep_alive_s = keep_alive_s
        self._qpos, self._qvel = _span(world.arm_qpos), _span(world.arm_qvel)
        acceleration_rad_s2 = np.array(world.robot.acceleration_rad_s2)
        self._path = PacedPath(self._positions(), self._period_s, acceleration_rad_s2)
        self._share = 1.0  # of speed, as it was asked for
        self._time_s = self._heard_s = 0.0
        self._late_periods = 0
        self._fault: str | None = None
        self._joints = len(world.arm_qpos)
        self._force_n: Array = np.zeros(3)
        self._samples = np.empty((KEPT_SAMPLES, 1 + 3 * self._joints))
        self._sampled = 0
        self.driven_rad_s: Array = np.zeros(self._joints)

    def state(self) -> ArmState:
        """Joints as measured; the mode tells of a protective stop. Raises DeviceFault where it has none."""
        if self._world.diverged:
            raise DeviceFault("simulation", "its physics came to no finite state; this is no fault of the cell")
        data = self._world.data
        return ArmState(
            self._time_s,
            tuple(data.qpos[self._qpos].tolist()),
            tuple(data.qvel[self._qvel].tolist()),
            self._path.moving,
            "normal" if self._fault is None else "protective_stop",
            self.path_s,
            self._fault or "",
            (float(self._force_n[0]), float(self._force_n[1]), float(self._force_n[2])),
        )

    @property
    def path_s(self) -> float | None:
        """How far it is along its trajectory; None where it follows none."""
        return self._path.path_s

    def follow(self, trajectory: JointTrajectory) -> JointTrajectory:
        """Start now, whatever it is; raises DeviceFault while a protective stop lasts."""
        self.refuse_stopped()
        self._path.follow(trajectory, self._share)
        self._heard_s = self._time_s
        return trajectory

    def stand_at(self, positions_rad: Array) -> None:
        """Be there at once, at rest."""
        self._world.put_arm(positions_rad)
        self._path.stand(positions_rad)

    def pace(self, share: float) -> None:
        """Follow at this share of the trajectory's speed, along the path that was checked for collisions."""
        self._share, self._heard_s = min(max(share, 0.0), 1.0), self._time_s

    def stop(self) -> None:
        """Slow down along the path that is being followed, and give up what is left of it."""
        self._path.stop()

    def acknowledge(self) -> None:
        """Somebody unlocked the protective stop at the arm."""
        self._fault, self._late_periods = None, 0

    def observe(self, time_s: float, /) -> None:
        """Measure the joints, and what pushes the tool: a knock is over before the next control period."""
        self._watch_force(tool_force_n(self._world))
        data, joints = self._world.data, self._joints
        row = self._samples[self._sampled % KEPT_SAMPLES]
        row[0] = time_s
        row[1 : 1 + joints] = data.qpos[self._qpos]
        row[1 + joints : 1 + 2 * joints] = data.qvel[self._qvel]
        row[1 + 2 * joints :] = data.qfrc_actuator[self._qvel]
        self._sampled += 1

    def samples(self) -> JointSamples:
        """What was measured since the last call."""
        count, self._sampled = self._sampled, 0
        rows = self._samples[:count].copy() if count <= KEPT_SAMPLES else np.roll(self._samples, -count, axis=0)
        return JointSamples(rows[:, 0], *np.split(rows[:, 1:], 3, axis=1))

    def update(self, time_s: float, dt_s: float) -> None:
        """Set the servos for one control period."""
        self._watch_tracking()
        felt_n = tool_force_n(self._world)
        self._watch_force(felt_n)
        self._force_n = self._force_n + FORCE_SHARE * (felt_n - self._force_n)
        here = self._path.at_rad
        silent = self._time_s - self._heard_s > self._keep_alive_s
        there = self._path.advance(0.0 if silent else self._share, dt_s)
        self.driven_rad_s = velocity = (there - here) / dt_s
        self._world.data.ctrl[self._world.arm_ctrl] = (here + there) / 2 + velocity * self._lag_s
        self._time_s = time_s + dt_s

    @property
    def tracking_error_rad(self) -> float:
        """Widest distance of a joint from its reference."""
        return float(np.abs(self._positions() - self._path.at_rad).max())

    def _positions(self) -> Array:
        positions: Array = self._world.data.qpos[self._qpos].copy()
        return positions

    def _watch_tracking(self) -> None:
        """Protective stop once the arm is held back from its reference."""
        self._late_periods = self._late_periods + 1 if self.tracking_error_rad > TRACKING_LIMIT_RAD else 0
        if self._late_periods >= TRACKING_PERIODS:
            error = np.abs(self._positions() - self._path.at_rad)
            self._protect(
                f"{self._world.robot.joints[int(error.argmax())]} is {error.max():.3f} rad from its trajectory, "
                f"limit {TRACKING_LIMIT_RAD} rad"
            )

    def _watch_force(self, felt_n: Array) -> None:
        """Protective stop once something pushes the tool, as the joints feel it."""
        if (force_n := float(np.linalg.norm(felt_n))) > FORCE_LIMIT_N:
            self._protect(f"something pushes the tool with {force_n:.0f} N, limit {FORCE_LIMIT_N:.0f} N")

    def _protect(self, why: str) -> None:
        """Hold still where it is."""
        if self._fault is None:
            self._fault = f"protective stop: {why}"
            self._path.stand(self._positions())

    def refuse_stopped(self) -> None:
        """Raise DeviceFault while a protective stop lasts."""
        if self._fault is not None:
            raise DeviceFault("arm", self._fault)


def tool_force_n(world: World) -> Array:
    """(3,) with which something pushes the tool, as the joints feel it, in the world; 0 for what they hardly feel."""
    model, data = world.model, world.data
    felt_nm = data.qfrc_constraint[world.arm_qvel]
    if np.abs(felt_nm).max() < FELT_NM:
        return np.zeros(3)
    jacobian = np.zeros((6, model.nv))
    mujoco.mj_jacBody(model, data, jacobian[:3], jacobian[3:], int(model.body("tool").id))
    force: Array = np.linalg.lstsq(jacobian[:, world.arm_qvel].T, felt_nm, rcond=SINGULAR)[0][:3]
    return force


def servo_lag_s(world: World) -> Array:
    """How far each servo trails a moving set point, (n,) as time; leading the set point by it makes up for it."""
    model = world.model
    stiffness: Array = model.actuator_gainprm[world.arm_ctrl, 0]
    damping: Array = -model.actuator_biasprm[world.arm_ctrl, 2] + model.dof_damping[world.arm_qvel]
    return damping / stiffness


def _span(indices: NDArray[np.int64]) -> slice:
    """Joints follow one another: a slice of the state takes a fifth of the time that a list of indices takes."""
    first, last = int(indices[0]), int(indices[-1])
    assert (indices == np.arange(first, last + 1)).all()
    return slice(first, last + 1)
