"""Tray, bins and table carry what falls onto them."""

from __future__ import annotations

import mujoco
import pytest

from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.product import Product
from bracket_sim.scene.clutter import standing
from bracket_sim.scene.world import build_world

SUNK_M = 0.001
HEIGHTS_M = (0.05, 0.15, 0.30)
AT_REST_S = 1.0


@pytest.mark.parametrize("part", ["o1", "o2", "o3"])
@pytest.mark.parametrize("place", ["tray", "bin", "table"])
def test_a_part_that_falls_on_its_peg_does_not_sink_in(part: str, place: str, product: Product, bench: Bench) -> None:
    tray = bench.tray.centre_m
    x, y, floor_m = {"tray": tray, "bin": bench.bins_m[part], "table": (tray[0], tray[1] + 0.4, 0.0)}[place]
    world = build_world(product, bench, [standing(product, bench.tray, part, (x, y), 0.3)])
    for height_m in HEIGHTS_M:
        world.place(world.bodies[0], Pose.from_yaw((x, y, floor_m + product.parts[part].peg_length_m + height_m), 0.3))
        for _ in range(round(AT_REST_S / world.model.opt.timestep)):
            mujoco.mj_step(world.model, world.data)
        touching = world.data.contact[: world.data.ncon]
        assert len(touching) > 0
        assert min(contact.dist for contact in touching) > -SUNK_M
