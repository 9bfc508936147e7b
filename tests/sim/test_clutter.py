"""Random trays: parts keep apart, stay in, come to rest where they were put, and often stand in each other's way."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from cell.interfaces.bench import Bench
from cell.interfaces.errors import InputError
from cell.interfaces.pose import Array
from cell.interfaces.product import Product
from sim.clutter import ScenePart, full_set, gap, rectangle, sample_clutter
from sim.settings import ClutterSettings
from sim.world import build_world


def footprints(product: Product, scene: tuple[ScenePart, ...]) -> list[Array]:
    return [
        rectangle(
            product.parts[entry.part].size_m,
            np.array(entry.world_from_part.position_m[:2]),
            entry.world_from_part.yaw_rad,
        )
        for entry in scene
    ]


def test_parts_keep_their_distance_from_each_other_and_the_rim(product: Product, bench: Bench) -> None:
    settings = ClutterSettings()
    room = np.array(bench.tray.size_m) / 2 - settings.rim_margin_m
    for seed in range(40):
        scene = sample_clutter(product, bench.tray, full_set(product), np.random.default_rng(seed), settings)
        bodies = footprints(product, scene)
        assert sorted(entry.part for entry in scene) == sorted(full_set(product))
        assert all((np.abs(body - bench.tray.centre_m[:2]) <= room + 1e-9).all() for body in bodies)
        assert min(gap(a, b) for a, b in combinations(bodies, 2)) >= settings.nearest_gap_m - 1e-6


def test_many_parts_have_a_close_neighbour(product: Product, bench: Bench) -> None:
    close = 0
    for seed in range(40):
        scene = sample_clutter(product, bench.tray, full_set(product), np.random.default_rng(seed))
        bodies = footprints(product, scene)
        gaps = np.array([[gap(a, b) if a is not b else 1.0 for b in bodies] for a in bodies])
        close += int((gaps.min(axis=1) < 0.018).sum())
    assert close > 0.4 * 40 * 6


def test_the_same_generator_gives_the_same_scene(product: Product, bench: Bench) -> None:
    first, second = (
        sample_clutter(product, bench.tray, ("o1", "o2", "o3"), np.random.default_rng(9)) for _ in range(2)
    )
    assert first == second


@pytest.mark.parametrize("seed", range(4))
def test_scenes_come_to_rest_where_they_were_put(product: Product, bench: Bench, seed: int) -> None:
    scene = sample_clutter(product, bench.tray, full_set(product), np.random.default_rng(seed))
    world = build_world(product, bench, scene)
    world.settle()
    for entry, part in zip(scene, world.bodies, strict=True):
        pose = world.part_pose(part)
        np.testing.assert_allclose(pose.position_m, entry.world_from_part.position_m, atol=5e-4)
        assert pose.rotation[2, 2] > 0.99999


def test_a_tray_that_is_full_says_so(product: Product, bench: Bench) -> None:
    with pytest.raises(InputError, match="no free spot"):
        sample_clutter(product, bench.tray, ("o3",) * 60, np.random.default_rng(0))
