"""Renders a compiled cell with MuJoCo, in whichever process its visible poses are known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import mujoco
import numpy as np
from numpy.typing import NDArray

from cell.interfaces.pose import Array

# What MuJoCo draws from: fields of its state, in the order of ScenePoses.
VISIBLE = ("geom_xpos", "geom_xmat", "site_xpos", "site_xmat", "cam_xpos", "cam_xmat", "light_xpos", "light_xdir")

ScenePoses = tuple[Array, ...]


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

    def render(self, camera: str | mujoco.MjvCamera, width_px: int, height_px: int) -> NDArray[np.uint8]:
        """One clean image (height, width, 3), RGB."""
        renderer = self._renderers.get((width_px, height_px))
        if renderer is None:
            renderer = self._renderers[width_px, height_px] = self._renderer(width_px, height_px)
        renderer.update_scene(self._scene.data, camera, self._options)
        image: NDArray[np.uint8] = renderer.render()
        return image

    def _renderer(self, width_px: int, height_px: int) -> mujoco.Renderer:
        """With a buffer no larger than the image, all of which is cleared for each image, and without a sky."""
        screen = self._scene.model.vis.global_
        largest = screen.offwidth, screen.offheight
        screen.offwidth, screen.offheight = width_px, height_px
        try:
            renderer = mujoco.Renderer(self._scene.model, height_px, width_px)
        finally:
            screen.offwidth, screen.offheight = largest
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SKYBOX] = False  # every camera looks down
        return renderer

    def close(self) -> None:
        """Let go of the graphics contexts; open ones complain when Python exits."""
        for renderer in self._renderers.values():
            renderer.close()
        self._renderers.clear()
