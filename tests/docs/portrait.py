"""The whole cell from the side, with shadows: `python -m tests.docs.portrait OUT.png --seed 0 --time 9`."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import cv2
import mujoco
import numpy as np
import yaml
from numpy.typing import NDArray

from bracket_ground.files.files import shipped
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.product import Product
from bracket_sim.cell import SimCell
from bracket_sim.scene.palette import FLOOR_GROUP
from bracket_sim.scene.settings import SimSettings
from bracket_sim.scene.world import World

CONFIG = shipped("bracket_cell.config")
SAMPLES = 8
SHADOW_MAP_PX = 4096


def portrait(world: World, width_px: int = 1280, height_px: int = 720) -> NDArray[np.uint8]:
    """Render the cell as it stands, (height, width, 3) RGB; slow, and without effect on the cell's cameras."""
    return picture(world, View((0.56, -0.05, 0.16), 1.85, -27.0, 152.0), width_px, height_px)


@dataclass(frozen=True)
class View:
    """From where one looks at what."""

    at_m: tuple[float, float, float]
    distance_m: float
    elevation_deg: float
    azimuth_deg: float


def picture(world: World, view: View, width_px: int, height_px: int) -> NDArray[np.uint8]:
    """As `portrait`, from anywhere."""
    camera = mujoco.MjvCamera()
    camera.lookat = list(view.at_m)
    camera.distance, camera.azimuth, camera.elevation = view.distance_m, view.azimuth_deg, view.elevation_deg
    options = mujoco.MjvOption()
    options.geomgroup[3], options.geomgroup[FLOOR_GROUP] = 0, 1
    with _good_light(world.model), mujoco.Renderer(world.model, height_px, width_px) as renderer:
        renderer.update_scene(world.data, camera, options)
        image: NDArray[np.uint8] = renderer.render()
    return image


@contextmanager
def _good_light(model: mujoco.MjModel) -> Iterator[None]:
    """Antialiasing, and shadows of the first lamp; put back afterwards."""
    quality = model.vis.quality
    before = (quality.offsamples, quality.shadowsize, quality.numslices, quality.numstacks)
    quality.offsamples, quality.shadowsize, quality.numslices, quality.numstacks = SAMPLES, SHADOW_MAP_PX, 36, 18
    model.light_castshadow[0] = 1
    try:
        yield
    finally:
        quality.offsamples, quality.shadowsize, quality.numslices, quality.numstacks = before
        model.light_castshadow[0] = 0


def main() -> None:
    """Let the person work for a while and take the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--time", type=float, default=9.0, help="seconds of work before the picture")
    options = parser.parse_args()
    product = Product.model_validate(yaml.safe_load((CONFIG / "products.yaml").read_text(encoding="utf-8")))
    bench = Bench.model_validate(yaml.safe_load((CONFIG / "cell.yaml").read_text(encoding="utf-8"))["bench"])
    cell = SimCell(product, bench, SimSettings(), "virtual", "portrait", options.seed, "random")
    try:
        cell.devices.clock.sleep_until(options.time)
        cv2.imwrite(str(options.out), cv2.cvtColor(portrait(cell.world), cv2.COLOR_RGB2BGR))
    finally:
        cell.close()


if __name__ == "__main__":
    main()
