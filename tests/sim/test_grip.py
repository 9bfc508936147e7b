"""A part that is held by friction stays where it is in the fingers, however the arm swings."""

from __future__ import annotations

import math

import numpy as np

from bracket_sim.scene.parts import ScenePart
from bracket_sim.scene.world import World, build_world
from tests.integration.cell_rig import BENCH, PRODUCT

MOVES, MOVE_S, SWING_RAD = 8, 1.0, 0.9
PERIOD_S = 0.008
SQUEEZE_M = 0.003  # 60 N


def held_part() -> World:
    """A world in which the fingers hold one part, an arm's length before the shoulder."""
    kind = PRODUCT.parts["o1"]
    world = build_world(PRODUCT, BENCH, [ScenePart("o1", BENCH.bracket.pose)])
    world.set_arm(BENCH.arm_look_rad)
    tool = world.tool_pose()
    x, y, z = tool.position_m
    world.place(world.bodies[0], type(tool).from_yaw((x, y, z - kind.size_m[2] / 2), tool.yaw_rad + math.pi / 2))
    world.set_opening(kind.size_m[1])
    world.drive_opening(kind.size_m[1] - SQUEEZE_M)
    return world


def in_tool_m(world: World) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Where the part is in the tool's frame (3,)."""
    return np.array((world.tool_pose().inverse() @ world.part_pose(world.bodies[0])).position_m)


def test_a_held_part_does_not_creep_as_the_arm_swings() -> None:
    world = held_part()
    start = np.array(BENCH.arm_look_rad)
    for _ in range(60):
        world.step_period()
    before = in_tool_m(world)
    for number in range(round(MOVES * MOVE_S / PERIOD_S)):
        angle = math.pi * number * PERIOD_S / MOVE_S
        world.data.ctrl[world.arm_ctrl[0]] = start[0] + SWING_RAD / 2 * (1 - math.cos(angle))
        world.step_period()
    assert np.linalg.norm(in_tool_m(world) - before) < 5e-4
