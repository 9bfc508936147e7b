"""What the controllers of both generations know of their arms: versions, lengths, and where the tool is."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, replace

import cv2
import numpy as np

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
        rows: as the maker publishes them, with this arm's own corrections.
    """

    name: str
    version: tuple[int, int, int, int]
    rate_hz: int
    rows: Calibration

    @property
    def checksums(self) -> tuple[int, ...]:
        """One for each joint: another calibration has others."""
        return tuple(zlib.crc32(repr(row).encode()) for row in zip(*self.rows.model_dump().values(), strict=True))

    def corrected(self, seed: int) -> Model:
        """Another arm of the same make."""
        spread = {"theta_rad": 1e-3, "a_m": 4e-4, "d_m": 4e-4, "alpha_rad": 5e-4}
        rng, makers = np.random.default_rng(seed), self.rows.model_dump()
        rows = {name: tuple((np.array(makers[name]) + rng.normal(0, by, 6)).tolist()) for name, by in spread.items()}
        return replace(self, rows=Calibration(**rows))

    def tool_pose(self, joints_rad: Array, tcp: Array) -> Array:
        """Tool in the controller's base frame: position and rotation vector, (6,)."""
        tool = np.eye(4)
        tool[:3, :3], tool[:3, 3] = cv2.Rodrigues(tcp[3:])[0], tcp[:3]
        pose = WORLD_FROM_BASE @ list(self.rows.frames(joints_rad))[-1] @ tool
        return np.concatenate([pose[:3, 3], cv2.Rodrigues(pose[:3, :3])[0].ravel()])


def _makers(a_m: tuple[float, ...], d_m: tuple[float, ...]) -> Calibration:
    return Calibration.model_validate({"theta_rad": (0.0,) * 6, "a_m": a_m, "d_m": d_m, "alpha_rad": ALPHA_RAD})


MODELS = {
    "ur10": Model(
        *("UR10", (3, 15, 8, 0), 125),
        _makers((0, -0.612, -0.5723, 0, 0, 0), (0.1273, 0, 0, 0.163941, 0.1157, 0.0922)),
    ),
    "ur10e": Model(
        *("UR10", (5, 12, 2, 0), 500),
        _makers((0, -0.6127, -0.57155, 0, 0, 0), (0.1807, 0, 0, 0.17415, 0.11985, 0.11655)),
    ),
}
