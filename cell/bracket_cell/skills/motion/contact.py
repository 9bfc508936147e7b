"""Where the arm could clamp a hand, and how fast it may close a gap there: the contact model of ISO/TS 15066, annex A.

A body region of stiffness k between the arm and what stands takes all of the arm's energy: v = F / sqrt(k m_R) with the
mass m_R = M / 2 + m_L of half of the moving arm and all of its load. A hand that is free to go takes less, as its own
mass is small: 280 N at 1.3 m/s of a UR10, which no slow arm reaches.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.robot import RobotModel


@dataclass(frozen=True)
class ContactLimits:
    """What a hand is like, and where it could be clamped. Origin: ISO/TS 15066, table A.3, and ISO 13854 for the gap.

    Attributes:
        stiffness_n_m: [N/m] of a hand.
        gap_m: [m] so wide a gap clamps neither hand nor forearm.
        clamped_n, free_n: [N] at most on a hand that is clamped, and on one that is free to go.
        unknown_kg: [kg] that an arm counts as whose file has no masses.
        least_kg: [kg] a file of a lighter arm has no masses.
    """

    stiffness_n_m: float = 75000.0
    gap_m: float = 0.12
    clamped_n: float = 140.0
    free_n: float = 280.0
    unknown_kg: float = 60.0
    least_kg: float = 1.0


CONTACT = ContactLimits()


def clamp_m_s(robot: RobotModel, force_n: float) -> float:
    """How fast a robot may close a gap in which a hand could be, for a force on it at most."""
    moving_kg = robot.moving_kg if robot.moving_kg >= CONTACT.least_kg else CONTACT.unknown_kg
    return force_n / math.sqrt(CONTACT.stiffness_n_m * (moving_kg / 2 + robot.gripper.loaded_kg))


def clamps(standing_m: Mapping[str, Array], robot: RobotModel, force_n: float | None) -> dict[str, object]:
    """The map that a person signs: at what a hand could be clamped, and how fast a gap there may close."""
    if force_n is None:
        return {}
    boxes = {name: np.round([at.min(axis=0), at.max(axis=0)], 4).tolist() for name, at in standing_m.items()}
    return {"closing_m_s": round(clamp_m_s(robot, force_n), 4), "at": boxes}


class ContactMap:
    """Gaps between the arm's links and what stands on the bench, as boxes along the axes around both."""

    def __init__(self, standing_m: Sequence[Array]) -> None:
        """Args:
        standing_m: corners (n, 3) of each thing that stands still.
        """
        self._low_m = np.array([corners.min(axis=0) for corners in standing_m]).T[:, np.newaxis, np.newaxis]
        self._high_m = np.array([corners.max(axis=0) for corners in standing_m]).T[:, np.newaxis, np.newaxis]

    def closing_m_s(self, corners_m: Array, step_s: float) -> Array:
        """(K - 1, L) how fast each link comes nearer to what it could clamp a hand against; 0 where nothing is so near.

        Args:
            corners_m: (3, 8, K, L) of links at K times.
            step_s: between these.
        """
        low_m, high_m = (edge[..., np.newaxis] for edge in (corners_m.min(axis=1), corners_m.max(axis=1)))
        apart_m = self._apart_m(low_m, high_m)
        near = ~(np.minimum(apart_m[:-1], apart_m[1:]) >= CONTACT.gap_m)
        closing: Array = np.where(near, apart_m[:-1] - apart_m[1:], 0.0).max(axis=2, initial=0.0) / step_s
        return closing

    def clamps(self, point_m: Array) -> bool:
        """Whether a hand that is touched there (3,) could be between the arm and what stands."""
        at_m = point_m.reshape(3, 1, 1, 1)
        return not bool((self._apart_m(at_m, at_m) >= CONTACT.gap_m).all())

    def _apart_m(self, low_m: Array, high_m: Array) -> Array:
        """(K, L, B) from boxes between corners (3, K, L, 1) to each that stands; negative where they overlap."""
        beside_m = np.maximum(low_m - self._high_m, self._low_m - high_m)
        apart_m: Array = np.sqrt((beside_m.clip(0.0) ** 2).sum(axis=0)) + beside_m.max(axis=0).clip(max=0.0)
        return apart_m
