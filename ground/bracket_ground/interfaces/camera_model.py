"""Camera with lens distortion: pixels to rays and back. Camera frame: x right, y down, z forward (OpenCV).

In normalised image coordinates (Brown, 1971; OpenCV's order k1, k2, p1, p2, k3):
x_d = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2),
y_d = y (1 + k1 r^2 + k2 r^4 + k3 r^6) + p1 (r^2 + 2 y^2) + 2 p2 x y.
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
        focal_px: focal length along the image's rows (fx).
        distortion_k1, distortion_k2, distortion_k3: radial distortion; 0 for none.
        focal_y_px: focal length along its columns (fy); as `focal_px` where it is None.
        principal_px: where the optical axis meets the image (cx, cy); in its middle where it is None.
        distortion_p1, distortion_p2: tangential distortion.
    """

    width_px: int
    height_px: int
    focal_px: float
    distortion_k1: float = 0.0
    distortion_k2: float = 0.0
    focal_y_px: float | None = None
    principal_px: tuple[float, float] | None = None
    distortion_p1: float = 0.0
    distortion_p2: float = 0.0
    distortion_k3: float = 0.0

    @property
    def matrix(self) -> Array:
        """K (3, 3)."""
        (fx, fy), (cx, cy) = self.focals_px, self.middle_px
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    @property
    def focals_px(self) -> Array:
        """Both focal lengths (2,): along rows, along columns."""
        return np.array([self.focal_px, self.focal_y_px or self.focal_px])

    @property
    def middle_px(self) -> Array:
        """The principal point (2,), as (column, row)."""
        return np.array(self.principal_px or ((self.width_px - 1) / 2, (self.height_px - 1) / 2))

    @property
    def distortion(self) -> tuple[float, float, float, float, float]:
        """In OpenCV's order: k1, k2, p1, p2, k3."""
        radial = self.distortion_k1, self.distortion_k2
        return (*radial, self.distortion_p1, self.distortion_p2, self.distortion_k3)

    def project(self, world_from_camera: Pose, points_m: Array) -> Array:
        """World points (n, 3) in [m] to pixels (n, 2) as (column, row)."""
        in_camera = world_from_camera.inverse().transform(points_m)
        image = in_camera @ self.matrix.T
        pixels: Array = image[:, :2] / image[:, 2:3]
        return self.bent(pixels)

    @property
    def plain(self) -> bool:
        """Whether the lens bends nothing."""
        return not any(self.distortion)

    def bent(self, pixels: Array) -> Array:
        """Where a pinhole camera's pixels (n, 2) are seen through this lens."""
        if self.plain:
            return pixels
        straight = self.normalised(pixels)
        bent: Array = (straight * self._stretch(straight) + self._askew(straight)) * self.focals_px + self.middle_px
        return bent

    def normalised(self, pixels: Array) -> Array:
        """Pixels (..., 2) of a pinhole camera as image coordinates: where their rays meet the plane at distance 1."""
        normalised: Array = (pixels - self.middle_px) / self.focals_px
        return normalised

    def straightened(self, pixels: Array) -> Array:
        """The inverse of `bent`."""
        if self.plain:
            return pixels
        bent = self.normalised(pixels)
        straight = bent
        askew = self._askew if self.distortion_p1 or self.distortion_p2 else np.zeros_like
        for _ in range(ITERATIONS):
            straight = (bent - askew(straight)) / self._stretch(straight)
        pinhole: Array = straight * self.focals_px + self.middle_px
        return pinhole

    def _stretch(self, straight: Array) -> Array:
        square = (straight**2).sum(axis=-1, keepdims=True)
        stretch: Array = 1 + self.distortion_k1 * square + self.distortion_k2 * square**2
        return stretch + self.distortion_k3 * square**3 if self.distortion_k3 else stretch

    def _askew(self, straight: Array) -> Array:
        """Tangential part (..., 2) of the distortion."""
        p1, p2 = self.distortion_p1, self.distortion_p2
        x, y = straight[..., :1], straight[..., 1:]
        square = x**2 + y**2
        along = 2 * p1 * x * y + p2 * (square + 2 * x**2), p1 * (square + 2 * y**2) + 2 * p2 * x * y
        return np.concatenate(along, axis=-1)

    def onto_plane(self, world_from_camera: Pose, pixels: Array, height_m: float | Array) -> Array:
        """Pixels (n, 2) as (column, row) to the world points (n, 3) where their rays meet z = height_m.

        Args:
            height_m: of all of them, or (n, 1).
        """
        in_camera = np.ones((len(pixels), 3))
        in_camera[:, :2] = self.normalised(self.straightened(pixels))
        rays = in_camera @ world_from_camera.rotation.T
        origin = np.array(world_from_camera.position_m)
        scale = (height_m - origin[2]) / rays[:, 2:3]
        points: Array = origin + rays * scale
        return points
