"""The compiled cell: repeatable bit for bit, and built from the product alone."""

from __future__ import annotations

import hashlib
import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from bracket_ground.errors import InputError
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.product import Product
from bracket_sim.cell import SimCell
from bracket_sim.scene.clutter import full_set, sample_clutter
from bracket_sim.scene.parts import ScenePart
from bracket_sim.scene.settings import PhysicsSettings, SimSettings
from bracket_sim.scene.storage import person_set
from bracket_sim.scene.world import build_world

ROOT = Path(__file__).parents[2]


def fingerprint(product: Product, bench: Bench, seed: int, channel: str) -> str:
    """Digest of joints and of the newest overhead image after a second with the person at work."""
    cell = SimCell(product, bench, SimSettings(), "virtual", channel, seed, "random")
    try:
        cell.devices.clock.sleep_until(1.0)
        frame = cell.devices.overhead.latest()
        assert frame is not None
        assert frame.sequence == 15
        return hashlib.sha256(cell.world.data.qpos.tobytes() + frame.image.tobytes()).hexdigest()
    finally:
        cell.close()


def test_the_same_seed_is_the_same_run_in_two_processes(product: Product, bench: Bench) -> None:
    script = (
        "import yaml; from tests.sim.test_world import fingerprint; from bracket_ground.interfaces.bench import Bench; "
        "from bracket_ground.interfaces.product import Product; from pathlib import Path; "
        "read = lambda name: yaml.safe_load(Path('config', name).read_text()); "
        "print(fingerprint(Product(**read('products.yaml')), Bench(**read('cell.yaml')['bench']), 3, 'other'))"
    )
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONHASHSEED": "77"}
    other = subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT, env=environment, capture_output=True, text=True, check=True
    )
    assert fingerprint(product, bench, 3, "this") == other.stdout.strip()


def test_another_seed_is_another_run(product: Product, bench: Bench) -> None:
    assert fingerprint(product, bench, 4, "four") != fingerprint(product, bench, 5, "five")


def four_types(product: Product, bench: Bench) -> tuple[Product, Bench]:
    """Four types at eight positions in two rows, one body turned wide."""
    data = product.model_dump()
    data["parts"]["o4"] = data["parts"]["o1"] | {
        "title": "ball valve",
        "quantity": 2,
        "shape": "box",
        "size_m": (0.05, 0.035, 0.03),
        "colour_rgb": (0.7, 0.6, 0.05),
    }
    data["bracket"]["holes_m"] = {
        f"p{row * 4 + column + 1}": (0.1 * row - 0.05, 0.12 - 0.08 * column) for row in range(2) for column in range(4)
    }
    data["goals"] = {
        "g0": ("o1", "o1", "o1", "o2", "o2", "o3", "o4", "o4"),
        "g1": ("o4", "o1", "o4", "o1", "o2", "o3", "o1", "o2"),
    }
    data["goal_titles"] = {}
    bins = {**bench.bins_m, "o4": (1.02, -0.26, 0.004)}
    return Product.model_validate(data), bench.model_copy(update={"bins_m": bins})


def test_another_product_gives_another_cell(product: Product, bench: Bench) -> None:
    product, bench = four_types(product, bench)
    tray = sample_clutter(product, bench.tray, full_set(product), np.random.default_rng(0))
    world = build_world(product, bench, (*person_set(product, bench), *tray))
    world.settle()
    assert len(world.bodies) == 16
    assert all(world.part_pose(part).rotation[2, 2] > 0.999 for part in world.bodies)
    holes = product.bracket.holes_m
    eight = [part for part in world.bodies if part.owner == "person"]
    for part, hole in zip(eight, holes.values(), strict=True):
        x, y, z = bench.bracket.position_m
        world.place(part, bench.bracket.pose.__class__((x + hole[0], y + hole[1], z + 0.004)))
    world.settle()
    for part in eight:
        assert world.part_pose(part).position_m[2] == pytest.approx(bench.bracket.position_m[2], abs=1e-3)


def test_seated_parts_rest_on_the_plate_and_stay(product: Product, bench: Bench) -> None:
    world = build_world(product, bench)
    x, y, z = bench.bracket.position_m
    for part, hole in zip(world.bodies, product.bracket.holes_m.values(), strict=True):
        world.place(part, bench.bracket.pose.__class__((x + hole[0] + 0.002, y + hole[1] - 0.002, z + 0.001)))
    world.settle()
    before = world.data.qpos.copy()
    for _ in range(125):
        world.step_period()
    parts = np.concatenate([np.arange(part.qpos, part.qpos + 3) for part in world.bodies])
    assert np.abs(world.data.qpos - before)[parts].max() < 2e-4
    assert all(abs(world.part_pose(part).position_m[2] - z) < 2e-4 for part in world.bodies)


def test_a_part_that_falls_on_the_plate_stays_above_it(product: Product, bench: Bench) -> None:
    """Eleven centimetres: a person loses it over a hole."""
    scene = [ScenePart(part, Pose((3.0, 3.0 + 0.3 * n, 0.1)), "person") for n, part in enumerate(product.parts)]
    world = build_world(product, bench, scene)
    world.set_arm(bench.arm_park_rad)
    tilted = Pose((0, 0, 0.11), (math.cos(0.02), math.sin(0.02), 0.0, 0.0))
    for body in world.bodies:
        for number, (x, y) in enumerate(product.bracket.holes_m.values()):
            beside = Pose((x + 0.003, y - 0.002, 0.0)) @ Pose.from_yaw((0, 0, 0), 1.57 * number)
            world.place(body, bench.bracket.pose @ beside @ tilted)
            for _ in range(60):
                world.step_period()
            assert world.part_pose(body).position_m[2] > bench.bracket.position_m[2] - 0.001
        world.place(body, Pose((3.0, 2.0, 0.1)))


def test_a_bracket_too_low_for_its_pegs_is_refused(product: Product, bench: Bench) -> None:
    low = bench.bracket.model_copy(update={"position_m": (0.72, 0.14, 0.012)})
    with pytest.raises(InputError, match=r"0\.012 m above the table, too low"):
        build_world(product, bench.model_copy(update={"bracket": low}))


def test_a_type_without_a_bin_is_refused(product: Product, bench: Bench) -> None:
    bins = {name: spot for name, spot in bench.bins_m.items() if name != "o2"}
    with pytest.raises(InputError, match="no place for o2; there is one for o1, o3"):
        build_world(product, bench.model_copy(update={"bins_m": bins}))


def test_holes_that_overlap_are_refused(product: Product, bench: Bench) -> None:
    holes = {**product.bracket.holes_m, "p2": (0.0, 0.185)}
    bracket = product.bracket.model_copy(update={"holes_m": holes})
    with pytest.raises(InputError, match="holes p1 and p2 overlap"):
        build_world(product.model_copy(update={"bracket": bracket}), bench)


def test_parts_that_sleep_wake_when_their_place_changes(product: Product, bench: Bench) -> None:
    world = build_world(product, bench, physics=PhysicsSettings(sleep=True))
    world.settle()
    for _ in range(60):
        world.step_period()
    assert len(world.data.contact.geom) == 0  # all sleep
    part = world.bodies[0]
    x, y, z = world.part_pose(part).position_m
    world.place(part, Pose((x, y, z + 0.05)))
    for _ in range(60):
        world.step_period()
    assert world.part_pose(part).position_m[2] == pytest.approx(z, abs=0.002)
