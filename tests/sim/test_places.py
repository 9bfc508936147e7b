"""Places with names and parts from meshes in the simulator: what stands there stands, and the score sees it."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pytest

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.learned.bench_watcher import ClassicalDetectors
from bracket_cell.learned.classical.settings import PerceptionSettings
from bracket_cell.viewing.page.scene import solid_of
from bracket_ground.interfaces.perception import HoleView
from bracket_ground.interfaces.places import BenchPlace
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.product import Product
from bracket_sim.cell import SimCell
from bracket_sim.scene.jobs import Job
from bracket_sim.scene.parts import ScenePart
from bracket_sim.scene.settings import SimSettings
from bracket_sim.scene.storage import at_places, overlapping
from bracket_sim.scene.world import World, build_world
from bracket_sim.truth.score import Score
from tests import ROOT

EXAMPLES = ROOT / "config" / "examples"
TENDING, MESH = (load_configuration(EXAMPLES / name / "cell.yaml") for name in ("tending", "mesh"))
VALVES, PUMP = load_product(TENDING, EXAMPLES / "tending"), load_product(MESH, EXAMPLES / "mesh")


def settled(world: World, time_s: float = 1.0) -> World:
    for _ in range(round(time_s / world.physics.sample_period_s)):
        world.step_sample()
    return world


def without_peg(product: Product) -> Product:
    bare = product.parts["housing"].model_copy(update={"peg_length_m": 0.0, "peg_diameter_m": 0.0})
    return product.model_copy(update={"parts": {**product.parts, "housing": bare}})


def test_the_example_bench_has_room_for_its_places() -> None:
    assert overlapping(VALVES, TENDING.bench) == []


def test_parts_stand_where_the_bench_file_fills_places() -> None:
    chuck = TENDING.bench.places["chuck"].model_copy(update={"filled": ("o2",)})
    bench = TENDING.bench.model_copy(update={"places": {**TENDING.bench.places, "chuck": chuck}})
    world = settled(build_world(VALVES, bench, at_places(VALVES, bench)))
    places = Score(world, Job("g0", {})).report()["places"]
    assert isinstance(places, dict)
    assert places["fixture"] == ["o1", "o2", "o2", "o1"]
    assert places["chuck"] == ["o2"], "its peg is in the hole"
    assert places["pallet"] == ["empty"] * 4


@pytest.mark.long
@pytest.mark.parametrize("filled", [("o2", "empty", "o1"), ("empty", "o3", "o3"), ("empty", "empty", "empty")])
@pytest.mark.parametrize("turn_rad", [0.0, 0.5])
def test_the_camera_sees_what_stands_at_a_place(filled: tuple[str, ...], turn_rad: float) -> None:
    upright = (math.cos(turn_rad / 2), 0.0, 0.0, math.sin(turn_rad / 2))
    nest = BenchPlace(
        position_m=(0.47, 0.24, 0.036),
        quaternion_wxyz=upright,
        seat="hole",
        rows=3,
        known_by="seen",
        filled=filled,
    )
    bench = TENDING.bench.model_copy(update={"places": {"nest": nest}, "obstacles": ()})
    looking: Mapping[str, HoleView] = {}
    expected = {f"nest {number}": None if part == "empty" else part for number, part in enumerate(filled)}
    for rendered in (False, True):
        cell = SimCell(
            VALVES,
            bench,
            SimSettings(),
            "virtual",
            f"nest-{rendered}",
            3,
            "g0",
            worker=False,
            clutter=[],
            rendered=rendered,
        )
        reader = (
            ClassicalDetectors(bench, VALVES, PerceptionSettings()).places().read
            if cell.sight is None
            else cell.sight.spots
        )
        for _ in range(8):
            cell.devices.clock.sleep_until(cell.devices.clock.now_s() + 0.1)
            frame = cell.devices.overhead.latest()
            looking = {} if frame is None else reader(frame, None)
        cell.close()
        assert {name: view.part for name, view in looking.items()} == expected, rendered


def test_a_part_beside_its_spot_does_not_count() -> None:
    bench = TENDING.bench
    spot = bench.places["pallet"].stands(0, 0.012)
    beside = Pose((spot.position_m[0] + 0.02, *spot.position_m[1:]))
    world = settled(build_world(VALVES, bench, [ScenePart("o1", beside)]), 0.2)
    places = Score(world, Job("g0", {})).report()["places"]
    assert isinstance(places, dict)
    assert places["pallet"] == ["empty"] * 4


@pytest.mark.parametrize("product", [PUMP, without_peg(PUMP)], ids=["on its peg", "on its body"])
def test_a_part_from_a_mesh_stands_still(product: Product) -> None:
    height_m = product.parts["housing"].peg_length_m
    world = settled(build_world(product, MESH.bench, [ScenePart("housing", Pose((0.1, 0.6, height_m + 0.002)))]), 2.0)
    pose = world.part_pose(world.bodies[0])
    assert pose.rotation[2, 2] > 0.99999
    assert np.allclose(pose.position_m, (0.1, 0.6, height_m), atol=5e-4)


def test_a_mesh_weighs_what_its_type_does_and_is_drawn_as_it_touches() -> None:
    world = build_world(without_peg(PUMP), MESH.bench, [ScenePart("housing", Pose((0.1, 0.6, 0.0)))])
    assert world.model.body_mass[world.bodies[0].body] == pytest.approx(PUMP.parts["housing"].mass_kg)
    for solid in PUMP.parts["housing"].solids:
        faces = np.array(solid_of(solid)["faces_m"])
        assert faces.shape[1:] == (3, 3)
        assert np.allclose(np.ptp(faces.reshape(-1, 3), axis=0), solid.size_m, atol=1e-4)


def test_a_rim_and_a_turn_are_built() -> None:
    place = BenchPlace(position_m=(0.3, 0.5, 0.02), quaternion_wxyz=(0.9238795, 0, 0, 0.3826834), wall_m=0.03)
    bench = TENDING.bench.model_copy(update={"places": {"nest": place}, "obstacles": ()})
    world = build_world(VALVES, bench, [])
    body = world.model.body("place nest")
    geoms = np.flatnonzero(world.model.geom_bodyid == body.id)
    assert len(geoms) == 5
    tops = world.data.geom_xpos[geoms][:, 2] + world.model.geom_size[geoms][:, 2]
    assert np.allclose(sorted(tops), [0.02, 0.05, 0.05, 0.05, 0.05])
