"""Simulated cameras: rendered by MuJoCo with the bench's intrinsics, then made noisy like a sensor."""

from __future__ import annotations

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray

from cell.interfaces.bench import CameraSetup
from cell.interfaces.perception import Frame
from sim.look import Camera
from sim.world import World

SLACK_S = 1e-6
BANK_FRAMES = 2  # length of the noise bank, in images


class Studio:
    """Renders a world; keeps one renderer for each image size and closes them all."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._renderers: dict[tuple[int, int], mujoco.Renderer] = {}
        self._options = mujoco.MjvOption()
        self._options.geomgroup[3] = 0

    def render(self, camera: str | mujoco.MjvCamera, width_px: int, height_px: int) -> NDArray[np.uint8]:
        """One clean image (height, width, 3), RGB."""
        renderer = self._renderers.get((width_px, height_px))
        if renderer is None:
            renderer = mujoco.Renderer(self._world.model, height_px, width_px)
            self._renderers[width_px, height_px] = renderer
        renderer.update_scene(self._world.data, camera, self._options)
        image: NDArray[np.uint8] = renderer.render()
        return image

    def close(self) -> None:
        """Let go of the graphics contexts; open ones complain when Python exits."""
        for renderer in self._renderers.values():
            renderer.close()
        self._renderers.clear()


class SimCamera:
    """Implements `Camera`; free-running at its rate, or one frame for each trigger.

    A frame k of a free-running camera is exposed at the first control period at or after k / rate.
    """

    def __init__(
        self,
        name: str,
        setup: CameraSetup,
        world: World,
        studio: Studio,
        look: Camera,
        rng: np.random.Generator,
    ) -> None:
        self._name, self._setup = name, setup
        self._world, self._studio = world, studio
        self._look, self._rng = look, rng
        # Drawing a normal number for each pixel costs as much as rendering, so frames cut theirs from a longer bank.
        size = setup.width_px * setup.height_px * 3
        bank = rng.standard_normal(BANK_FRAMES * size, dtype=np.float32) * look.noise_levels
        self._bank = np.rint(bank).astype(np.int16)
        self._sequence = 0
        self._triggered = False
        self._frame: Frame | None = None

    def trigger(self) -> None:
        """Expose at the next control period; ignored by a free-running camera."""
        self._triggered = self._setup.triggered

    def latest(self) -> Frame | None:
        """The newest frame."""
        return self._frame

    def observe(self, time_s: float, /) -> None:
        """Expose where a frame is due."""
        due = self._triggered if self._setup.triggered else time_s >= self._sequence / self._setup.rate_hz - SLACK_S
        if due:
            self._triggered = False
            self._expose(time_s)

    def _expose(self, time_s: float) -> None:
        image = self._studio.render(self._name, self._setup.width_px, self._setup.height_px)
        self._frame = Frame(self._name, self._sequence, time_s, self._spoil(image), self._world.camera_pose(self._name))
        self._sequence += 1

    def _spoil(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        gain = max(0.0, 1.0 + self._look.brightness_jitter * self._rng.standard_normal())
        start = int(self._rng.integers(self._bank.size - image.size + 1))
        grain = self._bank[start : start + image.size].reshape(image.shape)
        blur = self._look.blur_px
        seen = cv2.GaussianBlur(image, (0, 0), blur) if blur > 0 else image
        bright = cv2.convertScaleAbs(seen, alpha=gain)
        spoiled: NDArray[np.uint8] = cv2.add(bright, grain, dtype=cv2.CV_8U).astype(np.uint8, copy=False)
        spoiled.setflags(write=False)
        return spoiled
