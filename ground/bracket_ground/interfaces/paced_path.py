"""A joint trajectory that is followed at a share of its speed, and left for good only at rest on it."""

from __future__ import annotations

import numpy as np

from bracket_ground.interfaces.command import JointTrajectory
from bracket_ground.interfaces.pose import Array

LEAST_BRAKING = 0.5  # of what the joints may do, also where the path itself asks for all of it


class PacedPath:
    """Where the set points of an arm are, one control period after the other.

    Attributes:
        rate: of the trajectory's speed, as it is.
        following: a trajectory was begun and not given up, also once its end is reached.
        stopping: it is given up as soon as the arm stands.
    """

    def __init__(self, at_rad: Array, period_s: float, acceleration_rad_s2: Array) -> None:
        """Stand at joints (n,), of which each can brake and speed up by so much (n,)."""
        self._period_s, self._acceleration_rad_s2 = period_s, acceleration_rad_s2
        self.rate = 1.0
        self.stand(at_rad)

    def follow(self, trajectory: JointTrajectory, rate: float, from_s: float = 0.0) -> None:
        """Begin at once, at this share of its speed; where it was interrupted, from rest."""
        count = int(np.ceil(trajectory.duration_s / self._period_s - 1e-9))
        times = np.arange(count + 1) * self._period_s
        columns = [np.interp(times, trajectory.times_s, column) for column in trajectory.positions_rad.T]
        self._reference, self._progress = np.column_stack(columns), min(from_s / self._period_s, float(count))
        self.stopping, self.following, self.rate = False, True, rate if from_s == 0 else 0.0

    def stop(self) -> None:
        """Slow down along the path, and give up what is left of it."""
        self.stopping = self.moving

    def stand(self, at_rad: Array) -> None:
        """Give up the path, and be here."""
        self._reference, self._progress = at_rad[np.newaxis], 0.0
        self.stopping = self.following = False

    def advance(self, share: float, dt_s: float) -> Array:
        """Set points after another period in which this share of the speed is asked for, (n,)."""
        if self.moving:
            before = self.rate
            self.rate += self._change(0.0 if self.stopping else share, dt_s)
            self._progress = min(self._progress + (before + self.rate) / 2, len(self._reference) - 1.0)
        there = self.at_rad
        if self.stopping and (self.rate <= 0 or not self.moving):
            self.stand(there)
        return there

    @property
    def moving(self) -> bool:
        """The end is not reached."""
        return self._progress < len(self._reference) - 1

    @property
    def path_s(self) -> float | None:
        """How far along its trajectory it is; None where it follows none."""
        return self._progress * self._period_s if self.following else None

    @property
    def at_rad(self) -> Array:
        """Set points as they are, (n,)."""
        index = int(self._progress)
        part = self._progress - index
        if part == 0:
            row: Array = self._reference[index]
            return row
        between: Array = (1 - part) * self._reference[index] + part * self._reference[index + 1]
        return between

    def _change(self, share: float, dt_s: float) -> float:
        """How much the share of speed may change in this period, no joint beyond its acceleration."""
        wanted = share - self.rate
        if wanted == 0:
            return 0.0
        index = min(int(self._progress), len(self._reference) - 2)
        speeds = (self._reference[index + 1] - self._reference[index]) / dt_s
        after = self._reference[min(index + 2, len(self._reference) - 1)]
        before = self._reference[max(index - 1, 0)]
        bends = (after - self._reference[index + 1] - self._reference[index] + before) / (2 * dt_s**2)
        moves = np.abs(speeds) > 1e-6
        if not moves.any():
            return wanted
        limits = self._acceleration_rad_s2[moves] / np.abs(speeds[moves])
        along = bends[moves] * np.sign(speeds[moves]) * self.rate**2 / np.abs(speeds[moves])
        slowest = LEAST_BRAKING * limits.min()
        brake = max(float((limits + along).min()), slowest)
        hasten = max(float((limits - along).min()), slowest)
        return float(min(max(wanted, -brake * dt_s), hasten * dt_s))
