"""Renders a compiled cell with MuJoCo, in whichever process its visible poses are known."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import mujoco
import numpy as np
from numpy.typing import NDArray

from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.pose import Array
from bracket_sim.rendering.available import missing_library
from bracket_sim.scene.furniture import TABLE
from bracket_sim.scene.palette import FLOOR_GROUP

# What MuJoCo draws from: fields of its state, in the order of ScenePoses.
VISIBLE = ("geom_xpos", "geom_xmat", "site_xpos", "site_xmat", "cam_xpos", "cam_xmat", "light_xpos", "light_xdir")

ScenePoses = tuple[Array, ...]
SHINES, BLACK = 0.9, 0.15  # specular reflection of bare steel; largest colour share of what takes all light
CORNERS = np.array([[1, 1, 1], [1, -1, 1], [-1, 1, 1], [-1, -1, 1]])  # of an image, as signs


class Scene(Protocol):
    """A compiled model and a state of it."""

    @property
    def model(self) -> mujoco.MjModel: ...

    @property
    def data(self) -> mujoco.MjData: ...


@dataclass(frozen=True)
class Stage:
    """A scene of poses alone: nothing moves in it by itself."""

    model: mujoco.MjModel
    data: mujoco.MjData


def visible_poses(data: mujoco.MjData) -> ScenePoses:
    """Where everything that can be seen is now."""
    return tuple(np.array(getattr(data, field)) for field in VISIBLE)


def show_poses(data: mujoco.MjData, poses: ScenePoses) -> None:
    """Put everything that can be seen where it was."""
    for field, values in zip(VISIBLE, poses, strict=True):
        getattr(data, field)[:] = values


class Studio:
    """Renders a scene; keeps one renderer for each image size and closes them all."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._renderers: dict[tuple[int, int], mujoco.Renderer] = {}
        self._options = mujoco.MjvOption()
        self._options.geomgroup[3] = 0
        table = mujoco.mj_name2id(scene.model, mujoco.mjtObj.mjOBJ_GEOM, TABLE)
        self._table = table if table >= 0 else None
        self._half_m = scene.model.geom_size[table]
        self._past: dict[tuple[int, bytes, bytes], bool] = {}  # of the last camera, where it was

    def render(self, camera: str | mujoco.MjvCamera, width_px: int, height_px: int) -> NDArray[np.uint8]:
        """One clean image (height, width, 3), RGB."""
        image: NDArray[np.uint8] = self._ready(camera, width_px, height_px).render()
        return image

    def depths_m(self, camera: str, width_px: int, height_px: int) -> NDArray[np.float32]:
        """Distances (height, width) from the image plane."""
        renderer = self._ready(camera, width_px, height_px)
        renderer.enable_depth_rendering()
        depths: NDArray[np.float32] = renderer.render()
        renderer.disable_depth_rendering()
        return depths

    def unmatched(self, camera: str | mujoco.MjvCamera, width_px: int, height_px: int) -> NDArray[np.bool_]:
        """(height, width) where a thing is seen that gives stereo nothing to match: black, or shining as bare steel."""
        renderer = self._ready(camera, width_px, height_px)
        renderer.enable_segmentation_rendering()
        seen = renderer.render()
        renderer.disable_segmentation_rendering()
        model = self._scene.model
        own, shines = model.geom_rgba[:, :3].copy(), np.zeros(model.ngeom, bool)
        made = model.geom_matid >= 0
        own[made] = model.mat_rgba[model.geom_matid[made], :3]
        shines[made] = model.mat_specular[model.geom_matid[made]] >= SHINES
        weak = np.append(shines | (own.max(axis=1) < BLACK), False)  # the last: what is no geom
        found: NDArray[np.bool_] = weak[np.where(seen[..., 1] == mujoco.mjtObj.mjOBJ_GEOM, seen[..., 0], -1)]
        return found

    def _ready(self, camera: str | mujoco.MjvCamera, width_px: int, height_px: int) -> mujoco.Renderer:
        renderer = self._renderers.get((width_px, height_px))
        if renderer is None:
            renderer = self._renderers[width_px, height_px] = self._renderer(width_px, height_px)
        self._options.geomgroup[FLOOR_GROUP] = self._past_table(camera, width_px / height_px)
        renderer.update_scene(self._scene.data, camera, self._options)
        return renderer

    def _past_table(self, camera: str | mujoco.MjvCamera, aspect: float) -> bool:
        """Whether a camera may see more than the table's top and what is above; if not, the floor need not be drawn."""
        if self._table is None or not isinstance(camera, str):
            return True
        number, data = self._scene.model.camera(camera).id, self._scene.data
        seen = number, data.cam_xpos[number].tobytes(), data.cam_xmat[number].tobytes()
        if seen not in self._past:
            self._past = {seen: self._sees_past_table(number, aspect)}
        return self._past[seen]

    def _sees_past_table(self, number: int, aspect: float) -> bool:
        data, table = self._scene.data, self._table
        slope = math.tan(math.radians(self._scene.model.cam_fovy[number]) / 2)
        rays = (CORNERS * (aspect * slope, slope, -1.0)) @ data.cam_xmat[number].reshape(3, 3).T
        top_m = data.geom_xpos[table][2] + self._half_m[2]
        away = (top_m - data.cam_xpos[number][2]) / rays[:, 2]
        off_m = data.cam_xpos[number][:2] + away[:, np.newaxis] * rays[:, :2] - data.geom_xpos[table][:2]
        return not ((away > 0).all() and (np.abs(off_m) < self._half_m[:2]).all())

    def _renderer(self, width_px: int, height_px: int) -> mujoco.Renderer:
        """With a buffer no larger than the image, all of which is cleared for each image, and without a sky."""
        screen = self._scene.model.vis.global_
        largest = screen.offwidth, screen.offheight
        screen.offwidth, screen.offheight = width_px, height_px
        try:
            renderer = mujoco.Renderer(self._scene.model, height_px, width_px)
        except (ImportError, RuntimeError) as error:
            raise DeviceFault("renderer", missing_library(error) or str(error)) from error
        finally:
            screen.offwidth, screen.offheight = largest
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SKYBOX] = False  # every camera looks down
        return renderer

    def close(self) -> None:
        """Let go of the graphics contexts; open ones complain when Python exits."""
        for renderer in self._renderers.values():
            renderer.close()
        self._renderers.clear()
