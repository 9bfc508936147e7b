"""Images of drawn trays, as the wrist camera sees them: parts are put where they stand, nothing moves."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from typing import Any, TypeVar

import mujoco
import numpy as np
from numpy.typing import NDArray

from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.product import Product
from bracket_sim.rendering.studio import Studio
from bracket_sim.scene.look import NOMINAL
from bracket_sim.scene.parts import ScenePart
from bracket_sim.scene.settings import PhysicsSettings
from bracket_sim.scene.world import WorldPart, build_world

CAMERA = "wrist"
MOST_ALIKE = 8  # parts of one type in a tray
AWAY_M = -3.0  # height at which parts are that are not in the tray
BATCH = 100  # trays that the other process is asked for at once

Standing = Sequence[tuple[str, Pose]]  # type and world_from_part of everything in a tray
Asked = TypeVar("Asked")
Given = TypeVar("Given")


class TrayCamera:
    """Takes images of trays that are given part by part."""

    def __init__(self, product: Product, bench: Bench) -> None:
        names = [name for name in product.parts for _ in range(MOST_ALIKE)]
        scene = [ScenePart(name, Pose((0.2 * k, 0.0, AWAY_M))) for k, name in enumerate(names)]
        self._world = build_world(product, bench, scene, PhysicsSettings(), None, NOMINAL)
        self._world.set_arm(np.array(bench.arm_look_rad))
        self._studio, self._setup = Studio(self._world), bench.wrist

    def take(self, parts: Standing) -> tuple[NDArray[np.uint8], Pose]:
        """An image (height, width, 3) of these parts, and world_from_camera."""
        free: dict[str, list[WorldPart]] = {}
        for body in self._world.bodies:
            self._put(body, Pose((0.0, 0.0, AWAY_M)))
            free.setdefault(body.part, []).append(body)
        for name, pose in parts:
            self._put(free[name].pop(), pose)
        mujoco.mj_kinematics(self._world.model, self._world.data)
        mujoco.mj_camlight(self._world.model, self._world.data)
        image = self._studio.render(CAMERA, self._setup.width_px, self._setup.height_px)
        return image, self._world.camera_pose(CAMERA)

    def _put(self, body: WorldPart, pose: Pose) -> None:
        """Without working out contacts: nothing will move."""
        self._world.data.qpos[body.qpos : body.qpos + 7] = (*pose.position_m, *pose.quaternion_wxyz)


class _Task:
    """What the other process does, with its camera."""

    camera: TrayCamera

    @classmethod
    def begin(cls, product: Product, bench: Bench) -> None:
        cls.camera = TrayCamera(product, bench)

    @classmethod
    def do(cls, work: Callable[[TrayCamera, Any], Any], asked: Sequence[Any]) -> list[Any]:
        return [work(cls.camera, seed) for seed in asked]


@contextmanager
def camera_process(
    product: Product, bench: Bench, work: Callable[[TrayCamera, Asked], Given]
) -> Iterator[Callable[[Sequence[Asked]], list[Given]]]:
    """A camera in a process of its own, because OpenGL and torch do not get on in one.

    Args:
        work: a function of a module, of the camera and what is asked; it runs in the other process.

    Yields:
        A function that maps `work` over what is asked.
    """
    context = get_context("spawn")
    with ProcessPoolExecutor(1, context, initializer=_Task.begin, initargs=(product, bench)) as pool:

        def take(asked: Sequence[Asked]) -> list[Given]:
            batches = [asked[first : first + BATCH] for first in range(0, len(asked), BATCH)]
            return [tray for found in pool.map(_Task.do, [work] * len(batches), batches) for tray in found]

        yield take
