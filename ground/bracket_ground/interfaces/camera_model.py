"""Camera with radial distortion: pixels to rays and back. Camera frame: x right, y down, z forward (OpenCV).

x_d = x (1 + k1 r^2 + k2 r^4) in normalised image coordinates (Brown, 1971).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bracket_ground.interfaces.pose import Array, Pose

ITERATIONS = 12  # of the fixed point that takes distortion out


@dataclass(frozen=True)
class CameraModel:
    """Intrinsics of a camera.

    Attributes:
        width_px, height_px: image size.
        focal_px: focal length, the same along both axes.
        distortion_k1, distortion_k2: radial distortion; 0 for none.
    """

    width_px: int
    height_px: int
    focal_px: float
    distortion_k1: float = 0.0
    distortion_k2: float = 0.0

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

    @property
    def middle_px(self) -> Array:
        """The principal point (2,), as (column, row)."""
        return np.array([(self.width_px - 1) / 2, (self.height_px - 1) / 2])

    def project(self, world_from_camera: Pose, points_m: Array) -> Array:
        """World points (n, 3) in [m] to pixels (n, 2) as (column, row)."""
        in_camera = world_from_camera.inverse().transform(points_m)
        image = in_camera @ self.matrix.T
        pixels: Array = image[:, :2] / image[:, 2:3]
        return self.bent(pixels)

    @property
    def plain(self) -> bool:
        """Whether the lens bends nothing."""
        return self.distortion_k1 == self.distortion_k2 == 0

    def bent(self, pixels: Array) -> Array:
        """Where a pinhole camera's pixels (n, 2) are seen through this lens."""
        if self.plain:
            return pixels
        middle = self.middle_px
        straight = (pixels - middle) / self.focal_px
        bent: Array = straight * self._stretch(straight) * self.focal_px + middle
        return bent

    def straightened(self, pixels: Array) -> Array:
        """The inverse of `bent`."""
        if self.plain:
            return pixels
        middle = self.middle_px
        bent = (pixels - middle) / self.focal_px
        straight = bent
        for _ in range(ITERATIONS):
            straight = bent / self._stretch(straight)
        pinhole: Array = straight * self.focal_px + middle
        return pinhole

    def _stretch(self, straight: Array) -> Array:
        square = (straight**2).sum(axis=-1, keepdims=True)
        stretch: Array = 1 + self.distortion_k1 * square + self.distortion_k2 * square**2
        return stretch

    def onto_plane(self, world_from_camera: Pose, pixels: Array, height_m: float | Array) -> Array:
        """Pixels (n, 2) as (column, row) to the world points (n, 3) where their rays meet z = height_m.

        Args:
            height_m: of all of them, or (n, 1).
        """
        in_camera = np.ones((len(pixels), 3))
        in_camera[:, :2] = (self.straightened(pixels) - self.middle_px) / self.focal_px
        rays = in_camera @ world_from_camera.rotation.T
        origin = np.array(world_from_camera.position_m)
        scale = (height_m - origin[2]) / rays[:, 2:3]
        points: Array = origin + rays * scale
        return points
