"""A picture of a stack from above or aslant, the box around what is seen of each object, and where to grasp it."""

from __future__ import annotations

import atexit
import math
from dataclasses import dataclass
from functools import cache

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray

from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.stacks import Box, Corners, StackGrasp
from bracket_sim.stacks.stage import Stage

WIDTH_PX, HEIGHT_PX = 480, 360
FIELD_DEG = 42.0  # of view, from top to bottom
ABOVE_DEG, ASLANT_DEG = (80.0, 89.0), (38.0, 75.0)  # elevation of the view
ROOM = (1.0, 1.3)  # around the objects
LEAST_PX, LEAST_SHOWN = 90, 0.22  # of an object that is seen; of the box around all of it
MARGIN_PX = 2
VIEWS = 4  # that are tried
PLATE_M, SPARE_M, WIDEST_M = 0.025, 0.02, 0.14  # width of the fingers, room beside the object, stroke


@dataclass(frozen=True, eq=False)
class View:
    """What a camera sees.

    Attributes:
        image: (HEIGHT_PX, WIDTH_PX, 3), RGB.
        boxes: around what is seen of each object.
    """

    image: NDArray[np.uint8]
    boxes: tuple[Box, ...]
    grasps: tuple[StackGrasp, ...]


@dataclass(frozen=True, eq=False)
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
    studio = _Studio(stage)
    try:
        for _ in range(VIEWS):
            view = _tried(stage, studio, rng, slanted)
            if view is not None:
                return view
        return None
    finally:
        studio.close()


@cache
def _graphics() -> mujoco.GLContext:
    """The one OpenGL context of this process: a new one for each scene would take longer than the picture."""
    context = mujoco.GLContext(WIDTH_PX, HEIGHT_PX)
    atexit.register(context.free)
    return context


class _Studio:
    """Draws a stage as a camera sees it."""

    def __init__(self, stage: Stage) -> None:
        _graphics().make_current()
        self._stage, screen = stage, stage.model.vis.global_
        screen.offwidth, screen.offheight, screen.fovy = WIDTH_PX, HEIGHT_PX, FIELD_DEG
        self._context = mujoco.MjrContext(stage.model, mujoco.mjtFontScale.mjFONTSCALE_50)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
        self.scene = mujoco.MjvScene(stage.model, stage.model.ngeom + 10)
        self.scene.flags[mujoco.mjtRndFlag.mjRND_SKYBOX] = False

    def look(self, camera: mujoco.MjvCamera) -> NDArray[np.int64]:
        """(height, width) number of the geom that each pixel shows, -1 for none; the next image has the same view."""
        every = mujoco.mjtCatBit.mjCAT_ALL
        mujoco.mjv_updateScene(self._stage.model, self._stage.data, mujoco.MjvOption(), None, camera, every, self.scene)
        image = self._drawn(segments=True).astype(np.int64)
        marks = image[..., 0] + 256 * image[..., 1] + 65536 * image[..., 2]
        geom_of = np.full(self.scene.ngeom + 1, -1)
        for geom in self.scene.geoms[: self.scene.ngeom]:
            if geom.objtype == mujoco.mjtObj.mjOBJ_GEOM and geom.segid >= 0:
                geom_of[geom.segid + 1] = geom.objid
        shown: NDArray[np.int64] = geom_of[marks]
        return shown

    def image(self) -> NDArray[np.uint8]:
        """(height, width, 3), RGB."""
        return self._drawn(segments=False)

    def close(self) -> None:
        """Let go of the buffers."""
        self._context.free()

    def _drawn(self, *, segments: bool) -> NDArray[np.uint8]:
        for flag in (mujoco.mjtRndFlag.mjRND_SEGMENT, mujoco.mjtRndFlag.mjRND_IDCOLOR):
            self.scene.flags[flag] = segments
        whole, drawn = mujoco.MjrRect(0, 0, WIDTH_PX, HEIGHT_PX), np.zeros((HEIGHT_PX, WIDTH_PX, 3), np.uint8)
        mujoco.mjr_render(whole, self.scene, self._context)
        mujoco.mjr_readPixels(drawn, None, whole, self._context)
        return np.ascontiguousarray(drawn[::-1])


def _tried(stage: Stage, studio: _Studio, rng: np.random.Generator, slanted: bool) -> View | None:
    geoms = studio.look(_camera(stage, rng, slanted))
    owners, eye = _owners(stage, geoms), _eye(studio.scene)
    boxes = []
    for number in range(len(stage.bodies)):
        box = _seen(owners == number, eye.pixels(stage.points(number)))
        if box is None:
            return None
        boxes.append(box)
    grasps = tuple(grasp for number in range(len(stage.bodies)) for grasp in _grasps(stage, number, eye))
    return View(_exposed(studio.image(), rng), tuple(boxes), grasps)


def _camera(stage: Stage, rng: np.random.Generator, slanted: bool) -> mujoco.MjvCamera:
    """Looks at the middle of all objects, from so far that they fill the picture."""
    cloud = np.concatenate([stage.points(number) for number in range(len(stage.bodies))])
    middle = (cloud.min(axis=0) + cloud.max(axis=0)) / 2
    reach = float(np.linalg.norm(cloud - middle, axis=1).max())
    camera = mujoco.MjvCamera()
    camera.lookat[:] = middle
    camera.distance = max(0.25, reach / math.tan(math.radians(FIELD_DEG) / 2)) * rng.uniform(*ROOM)
    camera.azimuth = rng.uniform(-180, 180)
    camera.elevation = -rng.uniform(*(ASLANT_DEG if slanted else ABOVE_DEG))
    return camera


def _owners(stage: Stage, geoms: NDArray[np.int64]) -> NDArray[np.int64]:
    """(height, width) number of the object that each pixel shows; -1 for none."""
    number_of = np.full(stage.model.nbody, -1)
    number_of[stage.bodies] = np.arange(len(stage.bodies))
    found: NDArray[np.int64] = np.where(geoms >= 0, number_of[stage.model.geom_bodyid[geoms]], -1)
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
