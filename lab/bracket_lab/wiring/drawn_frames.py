"""Images of the simulated cell without a run: an assembly from above, trays, and crops of drawn trays.

A training with torch uses some of it: MuJoCo is only imported where it draws.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from bracket_cell.configuration import Configuration
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.product import Product
from bracket_lab.drawing.sight import mixed_clutter, sometimes_steel
from bracket_sim.scene.settings import settings_of

if TYPE_CHECKING:
    from bracket_cell.learned.grasp.crops import Crops, TrayCamera, View
    from bracket_ground.interfaces.bench import Bench
    from bracket_lab.drawing.trays import TrayCamera as Camera
    from bracket_lab.learned.parts.data import Scene


def overhead_frames(configuration: Configuration, product: Product, seed: int) -> Iterator[Frame]:
    """The person alone before the overhead camera."""
    from bracket_lab.drawing.hands import hand_frames
    from bracket_lab.drawing.recording import Source, record

    taken = record(product, configuration.bench, settings_of(configuration.devices.simulation), seed)
    source = Source(taken, product, configuration.bench)
    for seen in hand_frames(source, [range(len(taken.moments))]):
        yield seen.frame


def tray_scenes(
    configuration: Configuration, product: Product, seeds: Sequence[int], *, mixed: bool, steel_share: float = 0.0
) -> list[Scene]:
    """What the wrist camera sees of one tray for each seed, and what is true of it.

    Args:
        mixed: some parts lie or are stacked, some objects are unknown.
    """
    from bracket_ground.files.data_folder import DataFolder
    from bracket_lab.drawing.objects import write_objects
    from bracket_lab.learned.parts.data import load_scenes

    settings = settings_of(configuration.devices.simulation)
    with tempfile.TemporaryDirectory(prefix="cell-trays-") as name:
        folder = DataFolder(Path(name) / "objects", "trays")
        for seed in seeds:
            clutter = mixed_clutter(settings.clutter, seed) if mixed else settings.clutter
            simulation = settings.model_copy(update={"clutter": clutter})
            write_objects(sometimes_steel(product, steel_share, seed), configuration.bench, simulation, seed, folder)
        return load_scenes([Path(name) / "objects"], product)


@contextmanager
def tray_camera(product: Product, bench: Bench) -> Iterator[TrayCamera]:
    """A camera that cuts the images of drawn scenes to crops; it runs in a process of its own."""
    from bracket_lab.drawing.trays import camera_process

    with camera_process(product, bench, partial(crops_of_view, bench)) as take:
        yield take


def crops_of_view(bench: Bench, camera: Camera, view: View) -> Crops:
    """The crops of one view; scenes are drawn about the tray's middle, on a floor at height 0."""
    from bracket_cell.learned.grasp.crops import crops_of
    from bracket_ground.interfaces.pose import Pose

    boxes, parts = view
    world = Pose(bench.tray.centre_m)
    standing = [
        (name, world @ Pose.from_yaw((float(x), float(y), float(bottom)), float(yaw)))
        for name, (x, y), bottom, yaw in zip(boxes.types, boxes.centre_m, boxes.bottom_m, boxes.yaw_rad, strict=True)
    ]
    image, world_from_camera = camera.take(standing)
    seen = [replace(part, world_from_part=world @ part.world_from_part) for part in parts]
    return crops_of(image, bench.wrist.model, world_from_camera, seen)
