"""A camera at one place: world points to pixels and back, outlines of projected points, and masks of outlines."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.camera_model import CameraModel
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.pose import Array, Pose

LEAST_DEPTH_M = 0.05  # what is nearer to the camera is not drawn
_CORNERS = np.array([[x, y, z] for z in (0.0, 1.0) for x, y in ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5))])


class View:
    """One camera at one place: world points to pixels and back."""

    def __init__(self, model: CameraModel, world_from_camera: Pose) -> None:
        self.model = model
        self.world_from_camera = world_from_camera
        camera_from_world = world_from_camera.inverse().matrix[:3]
        self._projection = model.matrix @ camera_from_world

    @classmethod
    def of(cls, model: CameraModel, frame: Frame) -> View:
        """The view that a frame was taken from.

        Raises:
            DeviceFault: the image is not of the kind or size that the camera was set up with.
        """
        check_image(model, frame)
        return cls(model, frame.world_from_camera)

    def depths(self, points_m: Array) -> Array:
        """Distance (n,) of world points (n, 3) from the image plane; negative behind the camera."""
        depths: Array = points_m @ self._projection[2, :3] + self._projection[2, 3]
        return depths

    def pixels(self, points_m: Array) -> Array:
        """World points (n, 3) to pixels (n, 2) as (column, row)."""
        image = points_m @ self._projection[:, :3].T + self._projection[:, 3]
        pixels: Array = image[:, :2] / image[:, 2:3]
        return self.model.bent(pixels)

    def on_plane(self, pixels: Array, height_m: float) -> Array:
        """Pixels (n, 2) to the world (x, y) where they meet z = height_m, (n, 2)."""
        return self.model.onto_plane(self.world_from_camera, np.asarray(pixels, float), height_m)[:, :2]

    def pixels_per_m(self, point_m: Sequence[float]) -> float:
        """Scale of the image around a world point, across the view."""
        depth = float(self.world_from_camera.inverse().transform(np.array(point_m))[2])
        return self.model.focal_px / depth


def check_image(model: CameraModel, frame: Frame) -> None:
    """Refuse an image of another kind or size than detectors read.

    Raises:
        DeviceFault: it is grey, has transparency, is not of 8 bits, or has not the size of the camera's model.
    """
    image, device = frame.image, f"{frame.camera} camera"
    if image.dtype != np.uint8:
        raise DeviceFault(device, f"image has values of type {image.dtype}, must be uint8 (8 bits, from 0 to 255)")
    channels = image.shape[2] if image.ndim == 3 else 1
    if channels != 3:
        raise DeviceFault(device, f"image has {channels} channel{'s' * (channels > 1)}, must have 3: red, green, blue")
    height, width = image.shape[:2]
    if (width, height) != (model.width_px, model.height_px):
        raise DeviceFault(device, f"image is {width} x {height}, must be {model.width_px} x {model.height_px}")
    depth = frame.depth_mm
    if depth is not None and (depth.dtype != np.uint16 or depth.shape != (height, width)):
        wanted = f"must be uint16, {width} x {height}, in [mm]"
        raise DeviceFault(device, f"depth image is {depth.dtype} of shape {depth.shape}, {wanted}")


def body_corners(size_m: Sequence[float], x_m: float, y_m: float, yaw_rad: float, bottom_m: float) -> Array:
    """Corners (8, 3) of an upright body: four below, four above."""
    corners = _CORNERS * np.array(size_m)
    cosine, sine = np.cos(yaw_rad), np.sin(yaw_rad)
    x = corners[:, 0] * cosine - corners[:, 1] * sine + x_m
    y = corners[:, 0] * sine + corners[:, 1] * cosine + y_m
    return np.column_stack([x, y, corners[:, 2] + bottom_m])


def obstacle_mask(view: View, bench: Bench, around_px: int = 0) -> NDArray[np.uint8]:
    """1 where an obstacle of the bench is in an image (height, width), and so far around it."""
    mask = np.zeros((view.model.height_px, view.model.width_px), np.uint8)
    for obstacle in bench.obstacles:
        points_m = obstacle.points_m
        points_m = points_m[view.depths(points_m) > LEAST_DEPTH_M]
        if len(points_m) > 2:
            cv2.fillConvexPoly(mask, outline(view.pixels(points_m)).round().astype(np.int32), 1)
    return np.asarray(cv2.dilate(mask, np.ones((2 * around_px + 1,) * 2, np.uint8)), np.uint8)


def outline(pixels: Array) -> Array:
    """Convex hull of projected points (n, 2), in order around it, (k, 2)."""
    hull: Array = cv2.convexHull(pixels.astype(np.float32)).reshape(-1, 2).astype(np.float64)
    return hull


def fill(shape: tuple[int, int], polygon: Array, offset: tuple[int, int] = (0, 0)) -> NDArray[np.uint8]:
    """Mask (height, width) of a convex polygon whose pixels count from `offset` (column, row)."""
    mask = np.zeros(shape, np.uint8)
    # four fractional bits keep the outline's sub-pixel place
    cv2.fillConvexPoly(mask, np.round((polygon - np.array(offset)) * 16).astype(np.int32), 1, lineType=8, shift=4)
    return mask
