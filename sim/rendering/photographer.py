"""Turns exposures into frames: renders what a camera saw and spoils it like its sensor. Needs no world, only poses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from cell.interfaces.bench import CameraSetup
from cell.interfaces.perception import Frame
from cell.interfaces.pose import Pose
from sim.rendering.sensor import Image, Sensor
from sim.rendering.studio import ScenePoses, Stage, Studio, show_poses
from sim.scene.look import Camera


@dataclass(frozen=True)
class Exposure:
    """All that a frame is made from.

    Attributes:
        sequence: number of the camera's frame, from 0.
        world_from_camera: as the frame will tell it.
        moments: poses of everything that can be seen, from the shutter's opening to its closing.
    """

    camera: str
    sequence: int
    time_s: float
    world_from_camera: Pose
    moments: tuple[ScenePoses, ...]


@dataclass(frozen=True)
class SensorSetup:
    """How a camera's images come about; `rng` belongs to this sensor alone."""

    setup: CameraSetup
    look: Camera
    rng: np.random.Generator


class Photographer:
    """Makes the frames of some cameras, each camera's in their order.

    Args:
        model: the compiled cell.
        sensors: by the camera's name.
    """

    def __init__(self, model: mujoco.MjModel, sensors: Mapping[str, SensorSetup]) -> None:
        self._data = mujoco.MjData(model)
        self._studio = Studio(Stage(model, self._data))
        self._sensors = {name: Sensor(setup.setup, setup.look, setup.rng) for name, setup in sensors.items()}

    def take(self, exposure: Exposure) -> Frame:
        """The frame of an exposure."""
        sensor = self._sensors[exposure.camera]
        clean = [self._clean(exposure.camera, sensor, poses) for poses in exposure.moments]
        image = sensor.spoil(clean)
        return Frame(exposure.camera, exposure.sequence, exposure.time_s, image, exposure.world_from_camera)

    def _clean(self, camera: str, sensor: Sensor, poses: ScenePoses) -> Image:
        show_poses(self._data, poses)
        return self._studio.render(camera, sensor.width_px, sensor.height_px)

    def close(self) -> None:
        """Let go of the graphics contexts."""
        self._studio.close()
