"""What the controllers of both generations know of their arms: versions, lengths, and where the tool is."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, replace

import cv2
import numpy as np

from cell.interfaces.pose import Array

ALPHA_RAD = (np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0)


@dataclass(frozen=True)
class Model:
    """A controller's arm: Denavit-Hartenberg rows that the maker publishes, with this arm's own corrections.

    Attributes:
        name: as the dashboard tells it.
        version: of the controller's software.
        rate_hz: of its control.
        a_m, d_m: the rows' lengths.
        turns_rad: corrections of the joints' zeros.
    """

    name: str
    version: tuple[int, int, int, int]
    rate_hz: int
    a_m: tuple[float, ...]
    d_m: tuple[float, ...]
    turns_rad: tuple[float, ...] = (0.0,) * 6

    @property
    def checksums(self) -> tuple[int, ...]:
        """One for each joint: another calibration has others."""
        rows = zip(self.a_m, self.d_m, self.turns_rad, strict=True)
        return tuple(zlib.crc32(repr(row).encode()) for row in rows)

    def corrected(self, seed: int) -> Model:
        """Another arm of the same make."""
        rng = np.random.default_rng(seed)
        a_m, d_m = np.array(self.a_m) + rng.normal(0, 4e-4, 6), np.array(self.d_m) + rng.normal(0, 4e-4, 6)
        turns = rng.normal(0, 1e-3, 6)
        return replace(self, a_m=tuple(a_m.tolist()), d_m=tuple(d_m.tolist()), turns_rad=tuple(turns.tolist()))

    def tool_pose(self, joints_rad: Array, tcp: Array) -> Array:
        """Tool in the controller's base frame: position and rotation vector, (6,)."""
        pose = np.eye(4)
        for row in range(6):
            pose = pose @ _row(joints_rad[row] + self.turns_rad[row], self.d_m[row], self.a_m[row], ALPHA_RAD[row])
        tool = np.eye(4)
        tool[:3, :3], tool[:3, 3] = cv2.Rodrigues(tcp[3:])[0], tcp[:3]
        pose = pose @ tool
        return np.concatenate([pose[:3, 3], cv2.Rodrigues(pose[:3, :3])[0].ravel()])


MODELS = {
    "ur10": Model("UR10", (3, 15, 8, 0), 125, (0, -0.612, -0.5723, 0, 0, 0), (0.1273, 0, 0, 0.163941, 0.1157, 0.0922)),
    "ur10e": Model(
        "UR10", (5, 12, 2, 0), 500, (0, -0.6127, -0.57155, 0, 0, 0), (0.1807, 0, 0, 0.17415, 0.11985, 0.11655)
    ),
}


def _row(theta: float, d: float, a: float, alpha: float) -> Array:
    c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
    return np.array([[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0.0, sa, ca, d], [0.0, 0.0, 0.0, 1.0]])
