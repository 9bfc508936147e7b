"""docs/parts.png: every part in every posture, painted and in steel, and trays with parts on each other."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from bracket_cell.configuration import load_configuration
from bracket_ground.files.yaml_file import load_yaml
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.product import Product
from bracket_sim.scene.clutter import full_set, sample_clutter
from bracket_sim.scene.parts import ScenePart
from bracket_sim.scene.posture import TURNS, stance, whole
from bracket_sim.scene.settings import ClutterSettings
from bracket_sim.scene.unknown_objects import UNKNOWN
from bracket_sim.scene.world import World, build_world
from bracket_sim.truth.labels import resting_parts
from tests import ROOT
from tests.docs.portrait import View, picture

Image = NDArray[np.uint8]

PRODUCTS = ("products.yaml", "products_steel.yaml")
TRAY = ClutterSettings(lying_share=0.4, stacked_share=0.6, foreign_objects=1)
TRAY_SEEDS = (3, 7, 19, 20, 22, 23)
TILE_PX = 180
WIDE_PX = 360
TEXT_PX = 18


def sheet() -> Image:
    """The whole picture (height, width, 3), RGB: a row for each type and finish, then rows of trays."""
    bench = load_configuration().bench
    products = [load_yaml(ROOT / "config" / name, Product) for name in PRODUCTS]
    rows = [_row(_postures(product, bench, part)) for part in products[0].parts for product in products]
    trays = [_tray(products[number % 2], bench, seed) for number, seed in enumerate(TRAY_SEEDS)]
    return np.vstack([*rows, _row(trays[:3]), _row(trays[3:])])


def _row(tiles: Sequence[Image]) -> Image:
    return np.hstack(tiles)


def _postures(product: Product, bench: Bench, part: str) -> list[Image]:
    kind = product.parts[part]
    x, y, z = bench.tray.centre_m
    tiles = []
    for turn in TURNS:
        pose = Pose.from_yaw((x, y, z), 0.5) @ stance(whole(kind), turn).spot_from_body
        world = build_world(product, bench, [ScenePart(part, pose)])
        world.settle()
        tiles.append(
            _tile(world, f"{kind.title}, {turn}", TILE_PX, 0.5 * kind.size_m[2], 0.04 + 1.7 * kind.size_m[0], -35.0)
        )
    return tiles


def _tray(product: Product, bench: Bench, seed: int) -> Image:
    scene = sample_clutter(product, bench.tray, full_set(product), np.random.default_rng(seed), TRAY)
    world = build_world(product, bench, scene)
    world.settle()
    resting = resting_parts(world)
    lying = sum(one.posture == "lying" and not one.on_top and one.part != UNKNOWN for one in resting)
    told = f"{lying} lie, {sum(one.on_top for one in resting)} on others"
    return _tile(world, told, WIDE_PX, 0.02, 0.50, -50.0)


def _tile(world: World, text: str, size_px: int, height_m: float, distance_m: float, elevation_deg: float) -> Image:
    """One square picture of the tray's middle with a line of text below."""
    x, y, _ = world.bench.tray.centre_m
    world.set_arm([-1.6, *world.bench.arm_park_rad[1:]])
    image = picture(world, View((x, y, height_m), distance_m, elevation_deg, 150.0), size_px, size_px)
    label = np.full((TEXT_PX, size_px, 3), 255, np.uint8)
    cv2.putText(label, text, (4, TEXT_PX - 6), cv2.FONT_HERSHEY_SIMPLEX, 0.38, (20, 20, 20), 1, cv2.LINE_AA)
    return np.vstack([image, label])
