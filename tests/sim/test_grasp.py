"""Friction alone carries parts from the tray into their holes."""

from __future__ import annotations

import math

import pytest

from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.product import Product
from bracket_sim.scene.clutter import standing
from tests.sim.conftest import MakeRig
from tests.sim.rig import downwards

ABOVE_M = 0.14


@pytest.mark.long
@pytest.mark.parametrize(("part", "grip_m"), [("o1", 0.011), ("o2", 0.023), ("o3", 0.053)])
def test_a_part_goes_from_the_tray_into_its_hole(
    make_rig: MakeRig, product: Product, bench: Bench, part: str, grip_m: float
) -> None:
    x, y, _ = bench.tray.centre_m
    rig = make_rig([standing(product, bench.tray, part, (x + 0.03, y + 0.05), 0.3)])
    world = rig.cell.world
    rig.activate()
    rig.grip(0.085)
    height = world.part_pose(world.bodies[0]).position_m[2] + grip_m
    across = world.tool_pose().yaw_rad
    across += math.remainder(0.3 + math.pi / 2 - across, math.pi)
    for lift_m, duration_s in ((ABOVE_M, 2.5), (0.0, 1.0)):
        rig.move(downwards(x + 0.03, y + 0.05, height + lift_m, across), duration_s)
    rig.grip(0.0)
    assert rig.status["gOBJ"] == 2
    rig.move(downwards(x + 0.03, y + 0.05, height + ABOVE_M, across), 1.0)
    held = world.tool_pose().inverse() @ world.part_pose(world.bodies[0])
    assert abs(held.position_m[2] - grip_m) < 0.001
    assert held.rotation[2, 2] < -0.9999
    hx, hy, hz = (a + b for a, b in zip(bench.bracket.position_m, (*product.bracket.holes_m["p4"], 0.0), strict=True))
    lengthwise = across + math.remainder(math.pi / 2 - across, math.pi)
    for lift_m, duration_s in ((ABOVE_M, 2.5), (0.02, 1.0), (0.0, 0.6)):
        rig.move(downwards(hx, hy, hz + grip_m + lift_m, lengthwise), duration_s)
    rig.grip(0.075, 0.4)
    rig.move(downwards(hx, hy, hz + grip_m + ABOVE_M, lengthwise), 1.0)
    rig.wait(0.3)
    placement = rig.cell.score.placements()["p4"]
    assert (placement.part, placement.seated, placement.by) == (part, True, "robot")
