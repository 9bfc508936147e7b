"""Pinhole camera: pixels to rays and back. Camera frame: x right, y down, z forward (OpenCV)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cell.interfaces.pose import Array, Pose


@dataclass(frozen=True)
class CameraModel:
    """Intrinsics of an undistorted camera.

    Attributes:
        width_px, height_px: image size.
        focal_px: focal length, the same along both axes.
    """

    width_px: int
    height_px: int
    focal_px: float

    @property
    def matrix(self) -> Array:
        """K (3, 3), principal point in the image's middle."""
        return np.array(
            [
                [self.focal_px, 0.0, (self.width_px - 1) / 2],
                [0.0, self.focal_px, (self.height_px - 1) / 2],
                [0.0, 0.0, 1.0],
            ]
        )

    def project(self, world_from_camera: Pose, points_m: Array) -> Array:
        """World points (n, 3) in [m] to pixels (n, 2) as (column, row)."""
        in_camera = world_from_camera.inverse().transform(points_m)
        image = in_camera @ self.matrix.T
        pixels: Array = image[:, :2] / image[:, 2:3]
        return pixels

    def onto_plane(self, world_from_camera: Pose, pixels: Array, height_m: float) -> Array:
        """Pixels (n, 2) as (column, row) to the world points (n, 3) where their rays meet z = height_m."""
        homogeneous = np.column_stack([pixels, np.ones(len(pixels))])
        rays = homogeneous @ np.linalg.inv(self.matrix).T @ world_from_camera.rotation.T
        origin = np.array(world_from_camera.position_m)
        scale = (height_m - origin[2]) / rays[:, 2:3]
        points: Array = origin + rays * scale
        return points
