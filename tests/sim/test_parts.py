"""What one sees of a part and what touches come from one description, and it stands, lies and shines as it should."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from bracket_ground.files.yaml_file import load_yaml
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import Product
from bracket_sim.scene.parts import ScenePart
from bracket_sim.scene.world import World, build_world

CONFIG = Path(__file__).parents[2] / "config"
LYING = {"side": (0.5**0.5, 0.5**0.5, 0.0, 0.0), "end": (0.5**0.5, 0.0, 0.5**0.5, 0.0)}
BALL_VALVE = {
    "title": "ball valve",
    "size_m": (0.05, 0.03, 0.04),
    "shape": [
        {"solid": "box", "size_m": (0.05, 0.03, 0.006), "centre_m": (0.0, 0.0, 0.003)},
        {"solid": "ball", "size_m": (0.03, 0.03, 0.03), "centre_m": (0.0, 0.0, 0.018)},
        {"solid": "cylinder", "size_m": (0.008, 0.008, 0.01), "centre_m": (0.0, 0.0, 0.035)},
        {"solid": "box", "size_m": (0.03, 0.008, 0.004), "centre_m": (0.01, 0.0, 0.037)},
    ],
}


def world_of(product: Product, bench: Bench, pose: Pose | None = None) -> World:
    """A world with one part of each type side by side on the table, or one after the other at a height."""
    scene = []
    for number, (name, kind) in enumerate(product.parts.items()):
        spot = Pose((0.1, 0.55 + 0.12 * number, kind.peg_length_m))
        scene.append(ScenePart(name, spot if pose is None else Pose((0.1, 0.55 + 0.12 * number, 0.06)) @ pose))
    return build_world(product, bench, scene)


def extents(world: World, body: int, *, touching: bool) -> Array:
    """Least and greatest coordinates (2, 3) of the body above the peg, in the part's frame."""
    model, low, high = world.model, np.full(3, np.inf), np.full(3, -np.inf)
    for geom in np.flatnonzero(model.geom_bodyid == body):
        counts = model.geom_contype[geom] != 0 if touching else model.geom_group[geom] != 3
        drawn = model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH  # a cylinder's, see sim/bracket_sim/scene/parts.py
        round_m = model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_CYLINDER and not touching
        counts = not drawn and (counts or round_m)
        if not counts or model.geom_pos[geom][2] < 0:
            continue
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
        half = _half(model, geom, turn.reshape(3, 3))
        low, high = np.minimum(low, model.geom_pos[geom] - half), np.maximum(high, model.geom_pos[geom] + half)
    return np.array([low, high])


def _half(model: mujoco.MjModel, geom: int, turn: Array) -> Array:
    size, shape = model.geom_size[geom], model.geom_type[geom]
    if shape == mujoco.mjtGeom.mjGEOM_BOX:
        return np.asarray(np.abs(turn) @ size)
    if shape == mujoco.mjtGeom.mjGEOM_CYLINDER:
        axis = turn[:, 2]
        return np.asarray(size[1] * np.abs(axis) + size[0] * np.sqrt(np.maximum(1 - axis**2, 0.0)))
    return np.asarray(np.abs(turn) @ size)  # ellipsoids stand straight


@pytest.fixture(scope="module", params=["products.yaml", "products_steel.yaml"])
def world(request: pytest.FixtureRequest, bench: Bench) -> World:
    return world_of(load_yaml(CONFIG / request.param, Product), bench)


@pytest.mark.parametrize("touching", [True, False])
def test_what_is_seen_and_what_touches_fill_the_size_of_the_product_file(world: World, touching: bool) -> None:
    for part in world.bodies:
        length, width, height = world.product.parts[part.part].size_m
        wanted = [[-length / 2, -width / 2, 0.0], [length / 2, width / 2, height]]
        np.testing.assert_allclose(extents(world, part.body, touching=touching), wanted, atol=2e-4)


def test_a_part_has_its_mass_low_down(world: World) -> None:
    for part in world.bodies:
        kind = world.product.parts[part.part]
        assert world.model.body_mass[part.body] == pytest.approx(kind.mass_kg)
        assert world.model.body_ipos[part.body][2] < 0.4 * kind.size_m[2]


def test_parts_stand_on_their_pegs(world: World) -> None:
    world.settle()
    for part in world.bodies:
        assert world.part_pose(part).rotation[2, 2] > 0.99999
        assert world.part_pose(part).position_m[2] == pytest.approx(
            world.product.parts[part.part].peg_length_m, abs=5e-4
        )


def test_parts_stand_upright_in_their_holes(product: Product, bench: Bench) -> None:
    holes = [bench.bracket.pose @ Pose((x, y, 0.0005)) for x, y in product.bracket.holes_m.values()]
    for goal in product.goals:
        types = product.goal_placements(goal).values()
        scene = [ScenePart(part, hole) for part, hole in zip(types, holes, strict=True)]
        world = build_world(product, bench, scene)
        world.settle()
        assert all(world.part_pose(part).rotation[2, 2] > 0.9999 for part in world.bodies)


@pytest.mark.parametrize("side", LYING)
def test_parts_on_their_side_come_to_rest(product: Product, bench: Bench, side: str) -> None:
    world = world_of(product, bench, Pose((0.0, 0.0, 0.0), LYING[side]))
    for _ in range(4):
        world.settle()
    for part in world.bodies:
        assert abs(world.part_pose(part).rotation[2, 2]) < 0.9
        assert np.abs(world.data.qvel[part.qvel : part.qvel + 6]).max() < 0.05


def test_steel_shines_and_paint_does_not(world: World) -> None:
    shines = {world.model.geom_matid[geom] >= 0 for part in world.bodies for geom in geoms(world, part.body)}
    assert shines == {world.product.parts["o1"].finish == "steel"}


def geoms(world: World, body: int) -> NDArray[np.intp]:
    return np.flatnonzero(world.model.geom_bodyid == body)


def test_a_valve_of_ones_own_is_data(product: Product, bench: Bench) -> None:
    data = product.model_dump()
    data["parts"]["o2"] |= BALL_VALVE
    mine = Product.model_validate(data)
    world = world_of(mine, bench)
    world.settle()
    assert all(world.part_pose(part).rotation[2, 2] > 0.99999 for part in world.bodies)
    assert not mine.parts["o2"].alike_after_half_turn


def test_a_plain_box_is_touched_where_it_ends(bench: Bench) -> None:
    """A suction cup, or another part, comes to rest on its whole height, not below the fitting that is seen."""
    kind = {"title": "plain", "size_m": (0.04, 0.03, 0.02), "colour_rgb": (0.8, 0.1, 0.1), "mass_kg": 0.1}
    listed = {"parts": {"box": kind}, "goals": {"g": ["box"] * 6}}
    shipped = load_yaml(CONFIG / "products.yaml", Product)
    product = Product.model_validate({**shipped.model_dump(), **listed, "goal_titles": {}})
    world = world_of(product, bench)
    body = int(world.model.body("box_robot_0").id)
    assert np.allclose(extents(world, body, touching=True), extents(world, body, touching=False))
    assert extents(world, body, touching=True)[1][2] == pytest.approx(0.02)


def test_a_gasket_thinner_than_its_fitting_is_simulated(bench: Bench) -> None:
    gasket = {"title": "gasket", "size_m": (0.05, 0.03, 0.001), "colour_rgb": (0.8, 0.1, 0.1), "mass_kg": 0.01}
    product = load_yaml(CONFIG / "products.yaml", Product)
    thin = product.parts["o1"].model_validate(gasket)
    world_of(product.model_copy(update={"parts": {**product.parts, "o1": thin}}), bench)
