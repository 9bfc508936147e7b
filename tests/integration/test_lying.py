"""Parts that lie are set upright by the simulated robot: friction alone holds what is turned."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest

from bracket_cell.skills.lying import PickLying, SetUpright
from bracket_cell.skills.motion.lying_grasp import laid_out
from bracket_cell.skills.move_to import MoveTo
from bracket_cell.skills.pick_and_place import Place
from bracket_cell.skills.put_down import PutBack, PutDown
from bracket_ground.interfaces.command import Command
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.resting_pose import SIDES, UPRIGHT, side_up
from bracket_ground.interfaces.skill import SkillStatus
from bracket_sim.scene.parts import ScenePart
from bracket_sim.scene.world import WorldPart
from tests import ROOT
from tests.integration.cell_rig import BENCH, PRODUCT, robot_alone, run_tree
from tests.integration.lying_parts import Bench
from tests.integration.robot_alone import RobotAlone

TYPES = ("o1", "o2", "o3")


@pytest.fixture
def bench(request: pytest.FixtureRequest) -> Iterator[Bench]:
    with RobotAlone(TYPES, request.node.name) as robot:
        assert robot.run(MoveTo(robot.planner, "look")).status is SkillStatus.SUCCESS
        yield Bench(robot, np.random.default_rng(1), pixels=False)


def laid(bench: Bench, number: int, up: str) -> tuple[WorldPart, PartDetection]:
    """A part that lies with this side up, and how it is seen."""
    part = bench.robot.parts[number]
    assert bench.lay(part, up)
    seen = bench.seen(part)
    assert seen is not None
    return part, seen


@pytest.mark.long
@pytest.mark.parametrize(("number", "up"), [(0, "+y"), (0, "-x"), (1, "-y"), (1, "+x"), (2, "-y"), (2, "+x")])
def test_a_part_on_its_side_or_end_is_set_upright(bench: Bench, number: int, up: str) -> None:
    robot = bench.robot
    part, seen = laid(bench, number, up)
    progress = robot.run(SetUpright(robot.planner, seen, ()))
    assert (progress.status, progress.reason) == (SkillStatus.SUCCESS, f"{part.part} was let go upright")
    robot.wait(0.5)
    assert bench.stands(part)


def test_a_part_on_its_head_is_laid_on_another_side_first(bench: Bench) -> None:
    robot = bench.robot
    part, seen = laid(bench, 1, "-z")
    progress = robot.run(SetUpright(robot.planner, seen, ()))
    assert (progress.status, progress.reason) == (SkillStatus.SUCCESS, "o2 was let go on another side")
    robot.wait(0.5)
    assert side_up(robot.world.part_pose(part)) in (UPRIGHT, *SIDES[:4])


def test_where_no_room_is_left_to_set_it_down_nothing_moves(bench: Bench) -> None:
    robot = bench.robot
    _, seen = laid(bench, 1, "+y")
    tray = robot.bench.tray
    full = type(seen)("o3", 1.0, seen.world_from_part, (*tray.size_m, 0.01), (0, 0, 0, 0), upright=False)
    before = robot.observe().arm.positions_rad
    progress = robot.run(SetUpright(robot.planner, seen, (full,)))
    assert progress.status is SkillStatus.FAILURE
    assert robot.observe().arm.positions_rad == pytest.approx(before, abs=1e-3)


def test_a_halt_in_the_turn_stops_the_arm_and_keeps_the_part(bench: Bench) -> None:
    robot = bench.robot
    part, seen = laid(bench, 0, "+y")
    skill, command = SetUpright(robot.planner, seen, ()), Command()
    progress = skill.poll(robot.observe(), command)
    while not progress.reason.startswith("turning"):
        robot.act(command)
        command = Command()
        progress = skill.poll(robot.observe(), command)
        assert progress.status is SkillStatus.RUNNING
    skill.halt(command)
    robot.act(command)
    robot.wait(1.0)
    assert not robot.observe().arm.moving
    assert robot.observe().gripper.holding
    assert robot.world.part_pose(part).position_m[2] > 0.05
    place = robot.run(Place(robot.planner, "p2", part.part))
    assert place.reason == "cannot put o1 at p2: it is held as it lay"
    assert robot.run(MoveTo(robot.planner, "park", held=part.part)).status is SkillStatus.SUCCESS
    assert robot.observe().gripper.holding
    assert robot.run(PutBack(robot.planner, part.part, ())).status is SkillStatus.SUCCESS
    robot.wait(0.5)
    assert bench.stands(part)


def test_a_part_that_lies_is_lifted_as_it_is_held(bench: Bench) -> None:
    robot = bench.robot
    part, seen = laid(bench, 1, "+x")
    assert robot.run(PickLying(robot.planner, seen, ())).status is SkillStatus.SUCCESS
    assert robot.observe().gripper.holding
    assert robot.planner.lying is not None
    assert robot.world.part_pose(part).position_m[2] > 0.1
    before_person = Pose((0.86, -0.16, 0.0))
    assert robot.run(PutDown(robot.planner, part.part, before_person, "the spot")).status is SkillStatus.SUCCESS
    robot.wait(0.5)
    there = robot.world.part_pose(part)
    assert math.dist(there.position_m[:2], before_person.position_m[:2]) < 0.02
    assert side_up(there) in (UPRIGHT, "+x")


@pytest.mark.long
def test_a_tree_fetches_a_part_that_lies_from_pixels() -> None:
    side = laid_out(PRODUCT.parts["o3"], "-y")
    assert side is not None
    spot = Pose.from_yaw((0.52, -0.42, BENCH.tray.centre_m[2] + 0.001), 0.6)
    scene = [ScenePart("o3", spot @ side[0])]
    with robot_alone(scene, seed=3) as cell:
        outcome, recorded = run_tree(cell, ROOT / "trees" / "clear_and_grasp.xml")
        assert outcome.end == "finished", outcome
        assert "o3 was let go upright" in recorded.reasons()
        assert "holding o3" in recorded.reasons()
        stands = [cell.world.part_pose(body).rotation[2, 2] for body in cell.world.bodies]
        assert min(stands) > 0.999
