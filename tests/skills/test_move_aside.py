"""Free spots in the tray: inside, and clear of every other part."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bracket_cell.skills.motion.grasp_pose import footprint, gap_m
from bracket_cell.skills.motion.settings import MotionSettings
from bracket_cell.skills.move_aside import free_spots
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.product import Product

SETTINGS = MotionSettings()


def detection(product: Product, part: str, x: float, y: float, yaw: float) -> PartDetection:
    kind = product.parts[part]
    return PartDetection(part, 1.0, Pose.from_yaw((x, y, 0.016), yaw), kind.size_m, (0, 0, 0, 0))


@pytest.mark.parametrize("seed", range(8))
def test_spots_are_inside_the_tray_and_clear_of_others(product: Product, bench: Bench, seed: int) -> None:
    rng = np.random.default_rng(seed)
    middle, half = np.array(bench.tray.centre_m[:2]), np.array(bench.tray.size_m) / 2
    names = list(product.parts)
    parts = [
        detection(product, names[int(rng.integers(3))], x, y, rng.uniform(-3, 3))
        for x, y in middle + rng.uniform(-0.1, 0.1, (3, 2))
    ]
    kind = product.parts[parts[0].part]
    spots = free_spots(parts[0], kind, parts[1:], bench.tray, SETTINGS)
    assert spots
    for spot in spots:
        moved = detection(product, parts[0].part, spot.position_m[0], spot.position_m[1], spot.yaw_rad)
        assert np.all(np.abs(footprint(moved) - middle) <= half)
        assert spot.position_m[2] == pytest.approx(bench.tray.centre_m[2] + kind.peg_length_m)
        for other in parts[1:]:
            assert gap_m(footprint(moved), footprint(other)) >= SETTINGS.part_gap_m


def test_a_full_tray_has_no_spot(product: Product, bench: Bench) -> None:
    x, y, _ = bench.tray.centre_m
    others = [
        detection(product, "o3", x + dx, y + dy, math.pi / 2)
        for dx in (-0.12, -0.04, 0.04, 0.12)
        for dy in (-0.15, -0.05, 0.05, 0.15)
    ]
    part = detection(product, "o3", x, y, 0.0)
    assert free_spots(part, product.parts["o3"], others, bench.tray, SETTINGS) == []
