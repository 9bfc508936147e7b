"""Rigid poses: position in metres and unit quaternion wxyz; names read `world_from_tool`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Pose:
    """A rigid transform `a_from_b`: the pose of frame b in frame a.

    Attributes:
        position_m: (x, y, z) in [m].
        quaternion_wxyz: unit quaternion, scalar first.
    """

    position_m: tuple[float, float, float]
    quaternion_wxyz: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        norm = math.sqrt(sum(value * value for value in self.quaternion_wxyz))
        if not 0.999 < norm < 1.001:
            raise ValueError(f"quaternion {self.quaternion_wxyz} has norm {norm:.6f}, must be 1")

    @staticmethod
    def from_matrix(matrix: Array) -> Pose:
        """The pose of a homogeneous matrix (4, 4)."""
        return Pose(_triple(matrix[:3, 3]), _quaternion(matrix[:3, :3]))

    @staticmethod
    def from_yaw(position_m: Sequence[float], yaw_rad: float) -> Pose:
        """A pose turned about the vertical axis only."""
        return Pose(_triple(position_m), (math.cos(yaw_rad / 2), 0.0, 0.0, math.sin(yaw_rad / 2)))

    @property
    def rotation(self) -> Array:
        """Rotation matrix (3, 3)."""
        w, x, y, z = self.quaternion_wxyz
        return np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )

    @property
    def matrix(self) -> Array:
        """Homogeneous matrix (4, 4)."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.rotation
        matrix[:3, 3] = self.position_m
        return matrix

    @property
    def yaw_rad(self) -> float:
        """Heading of the frame's x axis about the vertical, in (-pi, pi]."""
        x_axis = self.rotation[:, 0]
        return math.atan2(x_axis[1], x_axis[0])

    def inverse(self) -> Pose:
        """`b_from_a` of `a_from_b`."""
        w, x, y, z = self.quaternion_wxyz
        return Pose(_triple(-self.rotation.T @ np.array(self.position_m)), (w, -x, -y, -z))

    def __matmul__(self, other: Pose) -> Pose:
        """Compose: `a_from_b @ b_from_c` is `a_from_c`."""
        return Pose.from_matrix(self.matrix @ other.matrix)

    def transform(self, points_m: Array) -> Array:
        """Points (..., 3) given in b, expressed in a."""
        moved: Array = np.asarray(points_m) @ self.rotation.T + np.array(self.position_m)
        return moved


def _triple(values: Sequence[float] | Array) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _quaternion(rotation: Array) -> tuple[float, float, float, float]:
    """Shepperd's method: divide by the largest component, so that no case is ill-conditioned."""
    r = rotation
    trace = r[0, 0] + r[1, 1] + r[2, 2]
    squares = np.array([trace, r[0, 0], r[1, 1], r[2, 2]])
    largest = int(np.argmax(squares))
    if largest == 0:
        q = np.array([1 + trace, r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    else:
        i = largest - 1
        j, k = (i + 1) % 3, (i + 2) % 3
        q = np.empty(4)
        q[0] = r[k, j] - r[j, k]
        q[1 + i] = 1 + r[i, i] - r[j, j] - r[k, k]
        q[1 + j] = r[j, i] + r[i, j]
        q[1 + k] = r[k, i] + r[i, k]
    q = q / np.linalg.norm(q)
    if q[0] < 0:
        q = -q
    w, x, y, z = (float(value) for value in q)
    return w, x, y, z


FINGERS_DOWN = Pose((0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0))  # a pose's z points upwards, the tool's along the fingers
