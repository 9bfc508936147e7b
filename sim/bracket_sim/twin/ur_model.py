"""What the controllers of both generations know of their arms: versions, lengths, and where the tool is."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from bracket_ground.errors import InputError
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.robot import WORLD_FROM_BASE, Calibration

ALPHA_RAD = (np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0)


@dataclass(frozen=True)
class Model:
    """A controller's arm.

    Attributes:
        name: as the dashboard tells it.
        version: of the controller's software.
        rate_hz: of its control.
        rows: as the maker publishes them, or with this arm's own corrections.
    """

    name: str
    version: tuple[int, int, int, int]
    rate_hz: int
    rows: Calibration

    @property
    def checksums(self) -> tuple[int, ...]:
        """One for each joint: another calibration has others."""
        return tuple(zlib.crc32(repr(row).encode()) for row in zip(*self.rows.model_dump().values(), strict=True))

    def tool_pose(self, joints_rad: Array, tcp: Array) -> Array:
        """Tool in the controller's base frame: position and rotation vector, (6,)."""
        tool = np.eye(4)
        tool[:3, :3], tool[:3, 3] = cv2.Rodrigues(tcp[3:])[0], tcp[:3]
        pose = WORLD_FROM_BASE @ list(self.rows.frames(joints_rad))[-1] @ tool
        return np.concatenate([pose[:3, 3], cv2.Rodrigues(pose[:3, :3])[0].ravel()])


# Lengths [m] that the maker publishes ("DH parameters for calculations of kinematics"): a2, a3, d1, d4, d5, d6.
OLD = {
    "ur3": (-0.24365, -0.21325, 0.1519, 0.11235, 0.08535, 0.0819),
    "ur5": (-0.425, -0.39225, 0.089159, 0.10915, 0.09465, 0.0823),
    "ur10": (-0.612, -0.5723, 0.1273, 0.163941, 0.1157, 0.0922),
}  # CB3
NEW = {
    "ur3e": (-0.24355, -0.2132, 0.15185, 0.13105, 0.08535, 0.0921),
    "ur5e": (-0.425, -0.3922, 0.1625, 0.1333, 0.0997, 0.0996),
    "ur10e": (-0.6127, -0.57155, 0.1807, 0.17415, 0.11985, 0.11655),
    "ur16e": (-0.4784, -0.36, 0.1807, 0.17415, 0.11985, 0.11655),
    "ur20": (-0.862, -0.7287, 0.2363, 0.201, 0.1593, 0.1543),
    "ur30": (-0.637, -0.5037, 0.2363, 0.201, 0.1593, 0.1543),
}  # PolyScope 5


def _model(name: str, version: tuple[int, int, int, int], rate_hz: int, lengths_m: Sequence[float]) -> Model:
    upper, fore, base, *wrist = lengths_m
    a_m, d_m = (0.0, upper, fore, 0.0, 0.0, 0.0), (base, 0.0, 0.0, *wrist)
    rows = {"theta_rad": (0.0,) * 6, "a_m": a_m, "d_m": d_m, "alpha_rad": ALPHA_RAD}
    return Model(name.removesuffix("e").upper(), version, rate_hz, Calibration.model_validate(rows))


MODELS = {
    **{name: _model(name, (3, 15, 8, 0), 125, lengths_m) for name, lengths_m in OLD.items()},
    **{name: _model(name, (5, 12, 2, 0), 500, lengths_m) for name, lengths_m in NEW.items()},
}


def model_of(name: str) -> Model:
    """The model of a robot's name, in letters of any case; raises InputError where the maker has none."""
    if (found := MODELS.get(name.lower())) is None:
        raise InputError(f"a twin of {name!r}: no such controller; legal names of a robot: {', '.join(MODELS)}")
    return found
