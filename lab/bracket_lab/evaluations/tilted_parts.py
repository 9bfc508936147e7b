"""What a part detector tells of parts that are tilted: the paper's "complex object orientations", as a curve.

Each image shows one part of each type, tilted about a horizontal axis of any direction, its lowest point on the tray.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from bracket_cell.learned.parts.maps import overlap, surface_of
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import PartDetector
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.product import Product
from bracket_lab.drawing.trays import CAMERA, TrayCamera
from bracket_lab.evaluations.actions import share
from bracket_lab.evaluations.holes_and_parts import Task

FOUND_IOU = 0.5  # of the boxes, as in mAP@.5
SPOT_M = 0.02  # parts are moved by so much from their share of the tray


def score_tilted(task: Task, seeds: Sequence[int], tilt_deg: float) -> dict[str, object]:
    """Shares of parts found as what they are, and of those that are told to stand, so that a robot grasps them.

    Args:
        seeds: an image each.
    """
    bench, product = task.configuration.bench, task.product
    detector: PartDetector = task.detectors(bench, "parts").make("parts")
    camera, found, stands = TrayCamera(product, bench), 0, 0
    for seed in seeds:
        rng = np.random.default_rng([seed, round(tilt_deg)])
        parts = list(tilted(product, bench, math.radians(tilt_deg), rng))
        image, world_from_camera = camera.take(parts)
        answers = detector.detect(Frame(CAMERA, seed, 0.0, image, world_from_camera))
        for name, pose in parts:
            surface_m = pose.transform(surface_of(product.parts[name]))
            surface = bench.wrist.model.project(world_from_camera, surface_m)
            box = np.concatenate([surface.min(axis=0), surface.max(axis=0)])
            own = [one for one in answers if one.part == name]
            there = [one for one in own if overlap(np.array(one.box_px, float), box) >= FOUND_IOU]
            found += bool(there)
            stands += any(one.upright for one in there)
    count = len(seeds) * len(product.parts)
    return {"tilt_deg": tilt_deg, "found": share(found, count), "stands": share(stands, count)}


def tilted(product: Product, bench: Bench, tilt_rad: float, rng: np.random.Generator) -> Iterator[tuple[str, Pose]]:
    """Type and world_from_part of a part of each type, in a row along the tray."""
    x_m, y_m, floor_m = bench.tray.centre_m
    places = np.linspace(-0.5, 0.5, len(product.parts) + 2)[1:-1] * bench.tray.size_m[1]
    for (name, kind), place_m in zip(product.parts.items(), rng.permutation(places), strict=True):
        off_m = rng.uniform(-SPOT_M, SPOT_M, 2)
        pose = _turned(tilt_rad, *rng.uniform(-math.pi, math.pi, 2))
        lowest_m = float(pose.transform(surface_of(kind))[:, 2].min())
        where_m = (x_m + off_m[0], y_m + place_m + off_m[1], floor_m - lowest_m)
        yield name, Pose(where_m, pose.quaternion_wxyz)


def _turned(tilt_rad: float, towards_rad: float, yaw_rad: float) -> Pose:
    """At the origin: turned by a yaw, then tilted towards a direction."""
    half = tilt_rad / 2
    axis = (math.cos(half), -math.sin(half) * math.sin(towards_rad), math.sin(half) * math.cos(towards_rad), 0.0)
    return Pose((0.0, 0.0, 0.0), axis) @ Pose.from_yaw((0.0, 0.0, 0.0), yaw_rad)
