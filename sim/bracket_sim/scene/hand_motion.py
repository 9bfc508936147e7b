"""How a hand moves: minimum-jerk reaches with a human's variation in speed and path (Flash and Hogan 1985)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from pydantic import Field

from bracket_ground.files.model import Model
from bracket_ground.interfaces.pose import Array

PEAK_TO_MEAN = 1.875  # of a minimum-jerk reach: its top speed over its mean speed
TREMOR_HZ = (7.0, 11.0)
FASTEST_M_S = 1.4  # of the commanded profile; skew and bow come on top


class MotionSettings(Model):
    """How fast and how evenly a hand reaches.

    Attributes:
        mean_speed_m_s: mean speed of a long reach; its peak is 1.875 times that.
        start_s: added to every reach, whatever its length.
        peak_speed_m_s: speed that no reach exceeds.
        speed_spread: standard deviation of the logarithm of a reach's duration.
        bow: standard deviation of the sideways bow, as a fraction of the reach's length.
        tremor_m: amplitude of the tremor in mid-reach.
    """

    mean_speed_m_s: float = Field(default=0.75, gt=0)
    start_s: float = Field(default=0.16, ge=0)
    peak_speed_m_s: float = Field(default=1.3, gt=0)
    speed_spread: float = Field(default=0.12, ge=0)
    bow: float = Field(default=0.04, ge=0)
    tremor_m: float = Field(default=0.0004, ge=0)


def at_pace(settings: MotionSettings, pace: float) -> MotionSettings:
    """The same habits, faster or slower; the top speed stays one that a human reach has."""
    return settings.model_copy(
        update={
            "mean_speed_m_s": settings.mean_speed_m_s * pace,
            "start_s": settings.start_s / pace,
            "peak_speed_m_s": min(settings.peak_speed_m_s * pace, max(settings.peak_speed_m_s, FASTEST_M_S)),
        }
    )


@dataclass(frozen=True, eq=False)
class Reach:
    """One reach from rest to rest.

    Attributes:
        start_m, end_m: (3,) where it begins and ends.
        bow_m: (3,) how far the path's middle is off the straight line.
        skew: shifts the speed's peak; positive is early, as human reaches to a small target are.
        tremor_m: (2, 3) amplitudes, by frequency and axis; tremor_rad their phases.
    """

    start_m: Array = field(repr=False)
    end_m: Array = field(repr=False)
    duration_s: float
    bow_m: Array = field(repr=False)
    skew: float
    tremor_m: Array = field(repr=False)
    tremor_rad: Array = field(repr=False)

    def at(self, time_s: float) -> Array:
        """Position (3,) in [m] at a time since the start, held at the ends."""
        fraction = min(max(time_s / self.duration_s, 0.0), 1.0)
        middle = (fraction * (1 - fraction)) ** 2
        done = min_jerk(fraction + self.skew * middle)
        phase = 2 * math.pi * np.array(TREMOR_HZ)[:, None] * time_s + self.tremor_rad
        tremor = 16 * middle * (self.tremor_m * np.sin(phase)).sum(axis=0)
        position: Array = self.start_m + done * (self.end_m - self.start_m) + 16 * middle * self.bow_m + tremor
        return position


def min_jerk(fraction: float) -> float:
    """Covered fraction of a minimum-jerk reach after a fraction of its duration."""
    return fraction**3 * (10 - 15 * fraction + 6 * fraction**2)


def plan_reach(
    start_m: Array,
    end_m: Array,
    settings: MotionSettings,
    rng: np.random.Generator,
    *,
    arch_m: float = 0.0,
    haste: float = 1.0,
) -> Reach:
    """Draw one reach.

    Args:
        arch_m: height of the path's middle above the straight line.
        haste: factor on the mean speed; below 1 for careful movements.
    """
    along = end_m - start_m
    length_m = float(np.linalg.norm(along)) + abs(arch_m)
    spread = math.exp(rng.normal(0.0, settings.speed_spread))
    slowest_s = PEAK_TO_MEAN * length_m / settings.peak_speed_m_s
    duration_s = max((settings.start_s + length_m / (settings.mean_speed_m_s * haste)) * spread, slowest_s)
    sideways = np.array([-along[1], along[0], 0.0])
    bow_m = sideways * rng.normal(0.0, settings.bow) + np.array([0.0, 0.0, arch_m])
    return Reach(
        start_m=start_m.copy(),
        end_m=end_m.copy(),
        duration_s=duration_s,
        bow_m=bow_m,
        skew=float(rng.uniform(0.0, 0.5)),
        tremor_m=rng.normal(0.0, settings.tremor_m, size=(2, 3)),
        tremor_rad=rng.uniform(0.0, 2 * math.pi, size=(2, 3)),
    )
