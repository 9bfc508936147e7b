"""Obstacles of a bench in the simulated cell: solid, seen, and where planner and configuration have them."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from bracket_ground.interfaces.bench import Bench, Obstacle
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.product import Product
from bracket_sim.scene.clutter import standing
from bracket_sim.scene.storage import overlapping
from bracket_sim.scene.world import build_world

TOP_M = 0.10
SHAPES: dict[str, dict[str, object]] = {
    "box": {"box_m": (0.12, 0.12, TOP_M)},
    "cylinder": {"cylinder_m": (0.12, TOP_M)},
    "mesh": {},
}
CORNERS = [(x, y, z) for x in (-0.06, 0.06) for y in (-0.06, 0.06) for z in (-TOP_M / 2, TOP_M / 2)]
FACES = [(1, 2, 3), (2, 3, 4), (5, 6, 7), (6, 7, 8), (1, 2, 5), (2, 5, 6), (3, 4, 7), (4, 7, 8), (1, 3, 5), (3, 5, 7)]
AT_M = (0.56, 0.10, TOP_M / 2)


def of_shape(shape: str, folder: Path) -> Obstacle:
    if shape == "mesh":
        lines = [
            *(f"v {x} {y} {z}" for x, y, z in CORNERS),
            *(f"f {a} {b} {c}" for a, b, c in [*FACES, (2, 4, 6), (4, 6, 8)]),
        ]
        (folder / "block.obj").write_text("\n".join(lines) + "\n")
        return Obstacle(name="block", position_m=AT_M, mesh=folder / "block.obj")
    return Obstacle.model_validate({"name": "block", "position_m": AT_M, **SHAPES[shape]})


@pytest.mark.parametrize("shape", SHAPES)
def test_a_part_that_falls_on_an_obstacle_stays_on_it(
    shape: str, product: Product, bench: Bench, tmp_path: Path
) -> None:
    with_it = bench.model_copy(update={"obstacles": (of_shape(shape, tmp_path),)})
    world = build_world(product, with_it, [standing(product, bench.tray, "o2", AT_M[:2], 0.3)])
    peg_m = product.parts["o2"].peg_length_m
    world.place(world.bodies[0], Pose.from_yaw((*AT_M[:2], TOP_M + peg_m + 0.01), 0.3))
    for _ in range(round(0.6 / world.model.opt.timestep)):
        mujoco.mj_step(world.model, world.data)
    assert world.data.xpos[world.bodies[0].body][2] == pytest.approx(TOP_M + peg_m, abs=0.012)


def test_an_obstacle_in_the_place_of_something_is_told_and_one_of_two_pieces_is_not(
    product: Product, bench: Bench
) -> None:
    def told(*obstacles: Obstacle) -> list[str]:
        return [what for _, what in overlapping(product, bench.model_copy(update={"obstacles": obstacles}))]

    def box(x: float, y: float, z: float = 0.1) -> Obstacle:
        return Obstacle(name="a lamp", position_m=(x, y, z), box_m=(0.05, 0.05, 0.1))

    assert "a lamp and the tray overlap" in told(box(0.56, -0.38))[0]
    assert "a lamp and the bracket overlap" in told(box(0.72, 0.14))[0]
    assert "a lamp and the bin of o1 overlap" in told(box(1.02, 0.34))[0]
    assert told(box(0.3, 0.3), box(0.31, 0.3)) == []
    assert told(box(0.56, -0.38, 0.8)) == [], "it hangs over the tray"


def test_shapes_have_the_points_that_the_configuration_tells(tmp_path: Path) -> None:
    for shape in SHAPES:
        points = of_shape(shape, tmp_path).points_m
        assert np.allclose((points.min(axis=0), points.max(axis=0)), ((0.50, 0.04, 0.0), (0.62, 0.16, TOP_M)))
