"""Random trays: parts keep apart, stay in, come to rest where they were put, and often stand in each other's way."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from bracket_ground.errors import InputError
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import Product
from bracket_ground.interfaces.solid import span_m
from bracket_sim.scene.clutter import full_set, gap, rectangle, sample_clutter, standing
from bracket_sim.scene.parts import ScenePart
from bracket_sim.scene.posture import stance, whole
from bracket_sim.scene.settings import ClutterSettings
from bracket_sim.scene.unknown_objects import UNKNOWN, draw_unknown_object
from bracket_sim.scene.world import World, build_world
from bracket_sim.truth.labels import resting_parts


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


MIXED = ClutterSettings(lying_share=0.5, stacked_share=0.6, foreign_objects=1)


def rested(product: Product, bench: Bench, seed: int, settings: ClutterSettings = MIXED) -> World:
    scene = sample_clutter(product, bench.tray, full_set(product), np.random.default_rng(seed), settings)
    world = build_world(product, bench, scene)
    world.settle()
    return world


@pytest.fixture(scope="module")
def worlds(product: Product, bench: Bench) -> list[World]:
    return [rested(product, bench, seed) for seed in range(8)]


@pytest.mark.long
def test_parts_that_lie_and_are_stacked_come_to_rest_in_the_tray(
    worlds: list[World], product: Product, bench: Bench
) -> None:
    middle, half = np.array(bench.tray.centre_m[:2]), np.array(bench.tray.size_m) / 2
    for world in worlds:
        assert sorted(part.part for part in world.bodies) == sorted([*full_set(product), UNKNOWN])
        assert set(world.parts.values()) == set(product.parts)
        for part in world.bodies:
            position = np.array(world.part_pose(part).position_m)
            assert (np.abs(position[:2] - middle) < half).all()
            assert position[2] > bench.tray.centre_m[2] - 1e-3
            assert np.abs(world.data.qvel[part.qvel : part.qvel + 6]).max() < 0.05


def test_the_truth_knows_what_stands_what_lies_and_what_is_on_what(
    worlds: list[World], product: Product, bench: Bench
) -> None:
    found = [resting_part for world in worlds for resting_part in resting_parts(world)]
    upright = [one for one in found if one.posture == "upright" and not one.on_top and one.part != UNKNOWN]
    on_top = [one for one in found if one.on_top]
    assert len(upright) > 8
    assert len([one for one in found if one.posture == "lying" and not one.on_top]) > 8
    assert len(on_top) > 3
    floor_m = bench.tray.centre_m[2]
    for one in upright:
        assert one.world_from_part.position_m[2] == pytest.approx(
            floor_m + product.parts[one.part].peg_length_m, abs=1e-3
        )


@pytest.mark.long
def test_what_is_set_down_on_others_stays_there_and_in_the_tray(product: Product, bench: Bench) -> None:
    settings = ClutterSettings(stacked_share=0.8)
    middle, half = np.array(bench.tray.centre_m[:2]), np.array(bench.tray.size_m) / 2
    on_top = 0
    for seed in range(4):
        scene = sample_clutter(product, bench.tray, full_set(product), np.random.default_rng(seed), settings)
        world = build_world(product, bench, scene)
        world.settle()
        for entry, part in zip(scene, world.bodies, strict=True):
            moved = np.subtract(world.part_pose(part).position_m, entry.world_from_part.position_m)
            assert np.linalg.norm(moved) < 0.004
            points = np.concatenate([solid.points() for solid in product.parts[part.part].whole])
            assert (np.abs(world.part_pose(part).transform(points)[:, :2] - middle) < half).all()
        on_top += sum(resting_part.on_top for resting_part in resting_parts(world))
    assert on_top >= 8  # of 20 that are asked for; what stays nowhere lies on the floor


def test_a_part_on_another_one_names_it(product: Product, bench: Bench) -> None:
    x, y, z = bench.tray.centre_m
    below = stance(whole(product.parts["o3"]), "left side")
    above = stance(whole(product.parts["o1"]), "left side")
    scene = [
        ScenePart("o3", Pose((x, y, z)) @ below.spot_from_body),
        ScenePart("o1", Pose.from_yaw((x, y - 0.012, z + 0.046), 0.0) @ above.spot_from_body),
        ScenePart("o2", standing(product, bench.tray, "o2", (x + 0.1, y), 0.0).world_from_part),
    ]
    world = build_world(product, bench, scene)
    world.settle()
    first, second, third = resting_parts(world)
    assert (first.posture, first.on) == ("lying", ())
    assert (second.posture, second.on) == ("lying", ("o3_robot_0",))
    assert (third.posture, third.on) == ("upright", ())
    for _ in range(25):
        world.step_period()
    assert not world.data.ncon  # they sleep, and nobody computes their contacts
    assert [resting_part.on for resting_part in resting_parts(world)] == [(), ("o3_robot_0",), ()]


def test_nominal_trays_stay_what_they_are(product: Product, bench: Bench) -> None:
    scene = sample_clutter(product, bench.tray, full_set(product), np.random.default_rng(0))
    settings = ClutterSettings(foreign_objects=2)
    with_things = sample_clutter(product, bench.tray, full_set(product), np.random.default_rng(0), settings)
    assert with_things[: len(scene)] == scene
    assert [entry.part for entry in with_things[len(scene) :]] == [UNKNOWN] * 2
    assert all(
        resting.posture == "upright" and not resting.on for resting in resting_parts(build_world(product, bench, scene))
    )


def test_things_that_nobody_knows_differ() -> None:
    rng = np.random.default_rng(0)
    things = [draw_unknown_object(rng) for _ in range(60)]
    assert len({thing.colour_rgb for thing in things}) >= 5
    assert len({tuple(solid.solid for solid in thing.solids) for thing in things}) >= 4
    for thing in things:
        extents = [span[1] - span[0] for axis in range(3) if (span := span_m(thing.solids, axis))]
        assert 0.01 < min(extents) < max(extents) < 0.085
        assert 0.003 < thing.mass_kg < 0.4
