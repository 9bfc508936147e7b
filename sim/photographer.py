"""Turns exposures into frames: renders what a camera saw and spoils it like its sensor. Needs no world, only poses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray

from cell.interfaces.bench import CameraSetup
from cell.interfaces.perception import Frame
from cell.interfaces.pose import Pose
from sim.look import Camera
from sim.studio import ScenePoses, Stage, Studio, show_poses

BANK_FRAMES = 2  # length of the noise bank, in images


@dataclass(frozen=True)
class Exposure:
    """All that a frame is made from.

    Attributes:
        sequence: number of the camera's frame, from 0.
        world_from_camera: as the frame will tell it.
        poses: of everything that can be seen.
    """

    camera: str
    sequence: int
    time_s: float
    world_from_camera: Pose
    poses: ScenePoses


@dataclass(frozen=True)
class SensorSetup:
    """How a camera's images come about; `rng` belongs to this sensor alone."""

    setup: CameraSetup
    look: Camera
    rng: np.random.Generator


class Sensor:
    """Spoils clean images; the same images in the same order come out the same."""

    def __init__(self, setup: SensorSetup) -> None:
        self.width_px, self.height_px = setup.setup.width_px, setup.setup.height_px
        self._look, self._rng = setup.look, setup.rng
        # Drawing a normal number for each pixel costs as much as rendering, so frames cut theirs from a longer bank.
        size = self.width_px * self.height_px * 3
        bank = self._rng.standard_normal(BANK_FRAMES * size, dtype=np.float32) * self._look.noise_levels
        self._bank = np.rint(bank).astype(np.int16)

    def spoil(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """What the sensor makes of the next clean image."""
        gain = max(0.0, 1.0 + self._look.brightness_jitter * self._rng.standard_normal())
        start = int(self._rng.integers(self._bank.size - image.size + 1))
        grain = self._bank[start : start + image.size].reshape(image.shape)
        blur = self._look.blur_px
        seen = cv2.GaussianBlur(image, (0, 0), blur) if blur > 0 else image
        bright = cv2.convertScaleAbs(seen, alpha=gain)
        spoiled: NDArray[np.uint8] = cv2.add(bright, grain, dtype=cv2.CV_8U).astype(np.uint8, copy=False)
        spoiled.setflags(write=False)
        return spoiled


class Photographer:
    """Makes the frames of some cameras, each camera's in their order.

    Args:
        model: the compiled cell.
        sensors: by the camera's name.
    """

    def __init__(self, model: mujoco.MjModel, sensors: Mapping[str, SensorSetup]) -> None:
        self._data = mujoco.MjData(model)
        self._studio = Studio(Stage(model, self._data))
        self._sensors = {name: Sensor(setup) for name, setup in sensors.items()}

    def take(self, exposure: Exposure) -> Frame:
        """The frame of an exposure."""
        sensor = self._sensors[exposure.camera]
        show_poses(self._data, exposure.poses)
        clean = self._studio.render(exposure.camera, sensor.width_px, sensor.height_px)
        image = sensor.spoil(clean)
        return Frame(exposure.camera, exposure.sequence, exposure.time_s, image, exposure.world_from_camera)

    def close(self) -> None:
        """Let go of the graphics contexts."""
        self._studio.close()
