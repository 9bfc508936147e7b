"""A picture of a stack from above or aslant, the box around what is seen of each object, and where to grasp it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray

from cell.interfaces.pose import Array
from cell.interfaces.stacks import Box, Corners, StackGrasp
from sim.stacks.stage import Stage

WIDTH_PX, HEIGHT_PX = 480, 360
FIELD_DEG = 42.0  # of view, from top to bottom
ABOVE_DEG, ASLANT_DEG = (80.0, 89.0), (38.0, 75.0)  # elevation of the view
ROOM = 1.12  # around the objects
LEAST_PX, LEAST_SHOWN = 90, 0.22  # of an object that is seen; of the box around all of it
MARGIN_PX = 2
VIEWS = 4  # that are tried
PLATE_M, SPARE_M, WIDEST_M = 0.025, 0.02, 0.14  # width of the fingers, room beside the object, stroke


@dataclass(frozen=True)
class View:
    """What a camera sees.

    Attributes:
        image: (HEIGHT_PX, WIDTH_PX, 3), RGB.
        boxes: around what is seen of each object.
    """

    image: NDArray[np.uint8]
    boxes: tuple[Box, ...]
    grasps: tuple[StackGrasp, ...]


@dataclass(frozen=True)
class Eye:
    """A pinhole camera: world points to pixels."""

    position_m: Array
    axes: Array  # rows: right, down, forwards

    def pixels(self, points_m: Array) -> Array:
        """(n, 2) of points (n, 3)."""
        seen = (points_m - self.position_m) @ self.axes.T
        focal = HEIGHT_PX / 2 / math.tan(math.radians(FIELD_DEG) / 2)
        return seen[:, :2] / seen[:, 2:] * focal + (WIDTH_PX / 2, HEIGHT_PX / 2)


def photograph(stage: Stage, rng: np.random.Generator, slanted: bool) -> View | None:
    """A view in which enough of every object is seen; None where several tries found none."""
    stage.model.vis.global_.fovy = FIELD_DEG
    renderer = mujoco.Renderer(stage.model, HEIGHT_PX, WIDTH_PX)
    try:
        for _ in range(VIEWS):
            view = _tried(stage, renderer, rng, slanted)
            if view is not None:
                return view
        return None
    finally:
        renderer.close()


def _tried(stage: Stage, renderer: mujoco.Renderer, rng: np.random.Generator, slanted: bool) -> View | None:
    camera = _camera(stage, rng, slanted)
    renderer.enable_segmentation_rendering()
    renderer.update_scene(stage.data, camera)
    owners = _owners(stage, renderer.render())
    eye = _eye(renderer.scene)
    boxes = []
    for number in range(len(stage.bodies)):
        whole = eye.pixels(stage.points(number))
        box = _seen(owners == number, whole)
        if box is None:
            return None
        boxes.append(box)
    renderer.disable_segmentation_rendering()
    renderer.update_scene(stage.data, camera)
    image = _exposed(renderer.render(), rng)
    grasps = tuple(one for number in range(len(stage.bodies)) for one in _grasps(stage, number, eye))
    return View(image, tuple(boxes), grasps)


def _camera(stage: Stage, rng: np.random.Generator, slanted: bool) -> mujoco.MjvCamera:
    """Looks at the middle of all objects, from so far that they fill the picture."""
    cloud = np.concatenate([stage.points(number) for number in range(len(stage.bodies))])
    middle = (cloud.min(axis=0) + cloud.max(axis=0)) / 2
    reach = float(np.linalg.norm(cloud - middle, axis=1).max()) * ROOM
    camera = mujoco.MjvCamera()
    camera.lookat[:] = middle
    camera.distance = reach / math.sin(math.radians(FIELD_DEG) / 2) * rng.uniform(0.95, 1.3)
    camera.azimuth = rng.uniform(-180, 180)
    camera.elevation = -rng.uniform(*(ASLANT_DEG if slanted else ABOVE_DEG))
    return camera


def _owners(stage: Stage, segments: NDArray[np.int32]) -> NDArray[np.int64]:
    """(height, width) number of the object that each pixel shows; -1 for none."""
    number_of = np.full(stage.model.nbody, -1)
    number_of[stage.bodies] = np.arange(len(stage.bodies))
    geoms, kinds = segments[..., 0], segments[..., 1]
    shown = (kinds == int(mujoco.mjtObj.mjOBJ_GEOM)) & (geoms >= 0)
    found: NDArray[np.int64] = np.where(shown, number_of[stage.model.geom_bodyid[np.where(shown, geoms, 0)]], -1)
    return found


def _eye(scene: mujoco.MjvScene) -> Eye:
    lens = scene.camera[0]
    forward, up = np.array(lens.forward), np.array(lens.up)
    position = (np.array(lens.pos) + np.array(scene.camera[1].pos)) / 2
    return Eye(position, np.stack([np.cross(forward, up), -up, forward]))


def _seen(mask: NDArray[np.bool_], whole_px: Array) -> Box | None:
    """The box around what is seen of an object; None where that is too little, or at the picture's edge."""
    if mask.sum() < LEAST_PX:
        return None
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    left, top, right, bottom = columns[0], rows[0], columns[-1], rows[-1]
    inside = min(left, top) >= MARGIN_PX and right < WIDTH_PX - MARGIN_PX and bottom < HEIGHT_PX - MARGIN_PX
    all_of_it = np.ptp(whole_px, axis=0).prod()
    if not inside or (right - left) * (bottom - top) < LEAST_SHOWN * all_of_it:
        return None
    return float(left), float(top), float(right), float(bottom)


def _exposed(image: NDArray[np.uint8], rng: np.random.Generator) -> NDArray[np.uint8]:
    """With the noise and the white balance of a cheap camera."""
    gain = rng.uniform(0.85, 1.15) * rng.uniform(0.96, 1.04, 3)
    noisy = image * gain + rng.normal(0, 2.5, image.shape)
    shot: NDArray[np.uint8] = np.clip(noisy, 0, 255).astype(np.uint8)
    return shot


def _grasps(stage: Stage, number: int, eye: Eye) -> list[StackGrasp]:
    """Across the largest piece, from above, where the fingers reach around it."""
    geoms = stage.geoms(number)
    largest = max(geoms, key=lambda geom: float(stage.model.geom_aabb[geom, 3:].prod()))
    corners = stage.corners(int(largest))
    (x, y), (length, width), turn_deg = cv2.minAreaRect(corners[:, :2].astype(np.float32))
    angle = math.radians(turn_deg) + (0.0 if length >= width else math.pi / 2)
    narrow = min(length, width)
    if narrow + SPARE_M > WIDEST_M:
        return []
    along, across = np.array([math.cos(angle), math.sin(angle)]), np.array([-math.sin(angle), math.cos(angle)])
    half = (narrow + SPARE_M) / 2 * across
    rectangle = [s * PLATE_M / 2 * along + t * half for s, t in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    points = np.array([[x + off[0], y + off[1], corners[:, 2].mean()] for off in rectangle])
    x1, y1, x2, y2, x3, y3, x4, y4 = (round(float(value), 1) for value in eye.pixels(points).ravel())
    drawn: Corners = (x1, y1, x2, y2, x3, y3, x4, y4)
    return [StackGrasp(drawn, number + 1)]
