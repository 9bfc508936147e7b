"""The camera over drawn trays from which the paper's grasp planner learns."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cell.interfaces.bench import Bench
    from cell.interfaces.product import Product
    from learned.grasp.crops import Crops, TrayCamera, View
    from sim.data.trays import TrayCamera as Camera


@contextmanager
def tray_camera(product: Product, bench: Bench) -> Iterator[TrayCamera]:
    """A camera that cuts the images of drawn scenes to crops; it runs in a process of its own."""
    from sim.data.trays import camera_process

    with camera_process(product, bench, partial(crops_of_view, bench)) as take:
        yield take


def crops_of_view(bench: Bench, camera: Camera, view: View) -> Crops:
    """The crops of one view; scenes are drawn about the tray's middle, on a floor at height 0."""
    from cell.interfaces.pose import Pose
    from learned.grasp.crops import crops_of

    boxes, parts = view
    world = Pose(bench.tray.centre_m)
    standing = [
        (name, world @ Pose.from_yaw((float(x), float(y), float(bottom)), float(yaw)))
        for name, (x, y), bottom, yaw in zip(boxes.types, boxes.centre_m, boxes.bottom_m, boxes.yaw_rad, strict=True)
    ]
    image, world_from_camera = camera.take(standing)
    seen = [replace(part, world_from_part=world @ part.world_from_part) for part in parts]
    return crops_of(image, bench.wrist.model, world_from_camera, seen)
