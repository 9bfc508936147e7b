"""Judging the bracket from the truth."""

from __future__ import annotations

import math

import pytest

from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.product import Product
from bracket_sim.scene.jobs import Job
from bracket_sim.scene.world import World, WorldPart, build_world
from bracket_sim.truth.score import Score
from tests.sim.worker_bench import product

PRODUCT = product()


def job(goal: str) -> Job:
    return Job(goal, PRODUCT.goal_placements(goal))


@pytest.fixture
def world(product: Product, bench: Bench) -> World:
    return build_world(product, bench)


def put(world: World, part: WorldPart, position: str, raised_m: float = 0.0, tilt_rad: float = 0.0) -> None:
    x, y = world.product.bracket.holes_m[position]
    lean = Pose((0.0, 0.0, 0.0), (math.cos(tilt_rad / 2), math.sin(tilt_rad / 2), 0.0, 0.0))
    world.place(part, world.bench.bracket.pose @ Pose((x, y, raised_m)) @ lean)


def fill(world: World, goal: str) -> dict[str, WorldPart]:
    spares = list(world.bodies)
    used = {}
    for position, wanted in world.product.goal_placements(goal).items():
        used[position] = next(part for part in spares if part.part == wanted)
        spares.remove(used[position])
        put(world, used[position], position)
    return used


@pytest.mark.parametrize("goal", ["g0", "g1", "g2"])
def test_a_bracket_filled_as_the_goal_says_is_correct(world: World, goal: str) -> None:
    fill(world, goal)
    report = Score(world, job(goal)).report()
    assert report["correct"]
    assert report["wrong_placements"] == 0
    assert report["placements"] == world.product.goal_placements(goal)


def test_an_empty_bracket_is_not_correct_but_nothing_is_wrong(world: World) -> None:
    report = Score(world, job("g0")).report()
    assert not report["correct"]
    assert (report["placements"], report["wrong_placements"]) == ({}, 0)


def test_another_goals_bracket_counts_each_wrong_hole(world: World) -> None:
    fill(world, "g1")
    wanted, found = (world.product.goal_placements(goal) for goal in ("g0", "g1"))
    report = Score(world, job("g0")).report()
    assert not report["correct"]
    assert report["wrong_placements"] == sum(wanted[position] != found[position] for position in wanted)


@pytest.mark.parametrize(("raised_m", "tilt_rad"), [(0.008, 0.0), (0.0, math.radians(8))])
def test_a_part_that_does_not_sit_is_wrong(world: World, raised_m: float, tilt_rad: float) -> None:
    used = fill(world, "g0")
    put(world, used["p4"], "p4", raised_m, tilt_rad)
    report = Score(world, job("g0")).report()
    assert not report["correct"]
    assert report["wrong_placements"] == 1


def test_a_part_that_the_gripper_still_lowers_is_in_no_hole(world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    part = world.bodies[0]
    put(world, part, "p1", raised_m=0.010)
    assert Score(world, job("g0")).placements()["p1"].part == part.part
    monkeypatch.setattr(world, "held", lambda: part)
    assert Score(world, job("g0")).placements() == {}
    put(world, part, "p1")
    assert Score(world, job("g0")).placements()["p1"].seated
