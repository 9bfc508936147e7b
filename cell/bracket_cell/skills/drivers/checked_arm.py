"""An arm of any driver that is never sent what it cannot or must not follow."""

from __future__ import annotations

import math

import numpy as np

from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.command import JointTrajectory
from bracket_ground.interfaces.devices import Arm, Loaded
from bracket_ground.interfaces.observation import ArmState, JointSamples
from bracket_ground.interfaces.robot import RobotModel

SPEED_TOLERANCE = 1.02  # sampled trajectories overshoot a little between their samples
ACCELERATION_TOLERANCE = 1.05
START_TOLERANCE_RAD = 0.05
LONGEST_STEP_S = 0.05  # within which a speed changes between two samples, however far apart they are


class CheckedArm:
    """Wraps a driver's arm and refuses illegal trajectories before the driver hears of them."""

    def __init__(self, arm: Arm, robot: RobotModel) -> None:
        self._arm, self._robot = arm, robot

    def state(self) -> ArmState:
        """As the driver reports it."""
        return self._arm.state()

    def follow(self, trajectory: JointTrajectory) -> JointTrajectory:
        """Follow it; raises DeviceFault where the arm cannot or must not, from where it is."""
        refuse_bad(trajectory, self._arm.state(), self._robot)
        return self._arm.follow(trajectory)

    def stop(self) -> None:
        """Controlled stop."""
        self._arm.stop()

    def pace(self, share: float) -> None:
        """Share of speed; what is not a number from 0 to 1 stands still."""
        self._arm.pace(min(max(share, 0.0), 1.0) if math.isfinite(share) else 0.0)

    def acknowledge(self) -> None:
        """Unlock a protective stop."""
        self._arm.acknowledge()

    def carry(self, held: bool) -> None:
        """Tell a driver that wants to know whether a part is held."""
        if isinstance(self._arm, Loaded):
            self._arm.carry(held)

    def samples(self) -> JointSamples | None:
        """As the driver reports them."""
        return self._arm.samples()


def refuse_bad(trajectory: JointTrajectory, state: ArmState, robot: RobotModel) -> None:
    """Raise DeviceFault for what an arm cannot or must not follow from where it is.

    That is: values that are not finite, a start elsewhere or at another time than 0, joints out of range, too much
    speed or acceleration, no rest at the beginning or the end.
    """
    positions, joints = trajectory.positions_rad, robot.joints
    if len(state.positions_rad) != len(joints):
        raise DeviceFault("arm", f"it tells {len(state.positions_rad)} joints, must be {len(joints)}")
    if not (np.isfinite(positions).all() and np.isfinite(trajectory.times_s).all()):
        raise DeviceFault("arm", "trajectory holds values that are not finite")
    if positions.ndim != 2 or positions.shape[1] != len(joints) or len(positions) != len(trajectory.times_s):
        raise DeviceFault("arm", f"trajectory has the shape {positions.shape}, must be (n, {len(joints)})")
    jump = np.abs(positions[0] - np.array(state.positions_rad))
    if not jump.max() <= START_TOLERANCE_RAD:
        raise DeviceFault(
            "arm",
            f"trajectory starts {jump.max():.3f} {robot.units[int(jump.argmax())]} from where "
            f"{joints[int(jump.argmax())]} is, limit {START_TOLERANCE_RAD}",
        )
    least, most = robot.limits_rad
    noise = np.clip(positions[0], least - START_TOLERANCE_RAD, most + START_TOLERANCE_RAD)  # beyond which it may stand
    back = (positions >= np.minimum(least, noise)) & (positions <= np.maximum(most, noise))
    if not (inside := (robot.within(positions) | back).all(axis=0)).all():
        joint = int(inside.argmin())
        least, most = robot.limits_rad[:, joint]
        span = f"{least:.3f} to {most:.3f} {robot.units[joint]}"
        raise DeviceFault("arm", f"trajectory leaves the range of {joints[joint]}, {span}")
    if trajectory.times_s[0] != 0:
        raise DeviceFault("arm", f"trajectory begins at {trajectory.times_s[0]:g} s, must begin at 0")
    _refuse_fast(trajectory, robot)


def _refuse_fast(trajectory: JointTrajectory, robot: RobotModel) -> None:
    limits_rad_s, limits_rad_s2 = np.array(robot.speed_rad_s), np.array(robot.acceleration_rad_s2)
    steps_s = np.diff(trajectory.times_s)
    if (steps_s <= 0).any():
        raise DeviceFault("arm", "trajectory's times do not increase")
    if not len(steps_s):
        return
    moves_rad_s = np.diff(trajectory.positions_rad, axis=0) / steps_s[:, np.newaxis]
    speeds = np.abs(moves_rad_s).max(axis=0)
    excess = speeds / limits_rad_s
    if excess.max() > SPEED_TOLERANCE:
        joint = int(excess.argmax())
        raise DeviceFault(
            "arm",
            f"trajectory moves {robot.joints[joint]} at {speeds[joint]:.2f} {robot.units[joint]}/s, "
            f"limit {limits_rad_s[joint]:.2f} {robot.units[joint]}/s",
        )
    rest = np.zeros((1, len(limits_rad_s)))
    changes_s = np.minimum(
        np.concatenate([steps_s[:1], (steps_s[1:] + steps_s[:-1]) / 2, steps_s[-1:]]), LONGEST_STEP_S
    )
    changes = np.abs(np.diff(np.concatenate([rest, moves_rad_s, rest]), axis=0)) / changes_s[:, np.newaxis]
    sample, joint = divmod(int((changes / limits_rad_s2).argmax()), len(limits_rad_s))
    if changes[sample, joint] > ACCELERATION_TOLERANCE * limits_rad_s2[joint]:
        where = {0: "at its beginning", len(steps_s): "at its end"}.get(sample, f"at {trajectory.times_s[sample]:g} s")
        raise DeviceFault(
            "arm",
            f"trajectory changes the speed of {robot.joints[joint]} by {changes[sample, joint]:.2f} "
            f"{robot.units[joint]}/s2 {where}, limit {limits_rad_s2[joint]:.2f} {robot.units[joint]}/s2",
        )
