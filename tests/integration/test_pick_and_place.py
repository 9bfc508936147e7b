"""Pick, place, move aside and move to on the simulated robot: friction alone holds what is carried."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from bracket_cell.skills.motion.grasp_pose import hole_pose
from bracket_cell.skills.move_aside import MoveAside
from bracket_cell.skills.move_to import MoveTo
from bracket_cell.skills.pick_and_place import Pick, Place
from bracket_ground.interfaces.command import Command, GripperCommand
from bracket_ground.interfaces.grasping import places_m
from bracket_ground.interfaces.grip import Grip, Hold
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.skill import SkillStatus
from bracket_sim.scene.world import WorldPart
from tests.integration.robot_alone import RobotAlone, tray_poses

SIGMA_M, SIGMA_RAD = 0.002, math.radians(2.0)
TYPES = ("o1", "o2", "o3")
BESIDE = [(0, Grip.WIDTH), (1, Grip.WIDTH), (2, Grip.WIDTH), (0, Grip.LENGTH), (1, Grip.LENGTH)]


@pytest.fixture
def robot(request: pytest.FixtureRequest) -> Iterator[RobotAlone]:
    with RobotAlone(TYPES, request.node.name) as robot:
        assert robot.run(MoveTo(robot.planner, "look")).status is SkillStatus.SUCCESS
        yield robot


def pick_and_place(robot: RobotAlone, part: WorldPart, position: str, rng: np.random.Generator) -> str | None:
    """One cycle from look to look; None where the part then stands in its hole, otherwise what went wrong."""
    x, y, yaw = tray_poses(robot.bench, 1, rng)[0]
    robot.stand(part, (x, y), yaw)
    robot.wait(0.4)
    seen = robot.detection(part, rng, SIGMA_M, SIGMA_RAD)
    for skill in (
        Pick(robot.planner, seen),
        Place(robot.planner, position, part.part),
        MoveTo(robot.planner, "look"),
    ):
        progress = robot.run(skill)
        if progress.status is not SkillStatus.SUCCESS:
            return progress.reason
    return robot.seated(part, position)


def stand_with_its_sides_blocked(robot: RobotAlone, part: WorldPart, rng: np.random.Generator) -> list[PartDetection]:
    """The part among the others so that only its ends are free; what is seen: the part first."""
    x, y, yaw = tray_poses(robot.bench, 1, rng, margin_m=0.13)[0]
    others = [other for other in robot.parts if other is not part]
    width = robot.product.parts[part.part].size_m[1]
    robot.stand(part, (x, y), yaw)
    for side, other in zip((1.0, -1.0), others, strict=True):
        away = side * (width / 2 + 0.006 + robot.product.parts[other.part].size_m[1] / 2)
        robot.stand(other, (x - math.sin(yaw) * away, y + math.cos(yaw) * away), yaw)
    robot.wait(0.4)
    return [robot.detection(seen, rng, 0.001, math.radians(1.0)) for seen in (part, *others)]


def pick_across_the_length_and_place(robot: RobotAlone, part: WorldPart, position: str, seed: int) -> str | None:
    """None where a part between two others then stands in its hole and the others stand where they were."""
    rng = np.random.default_rng(seed)
    seen, *others = stand_with_its_sides_blocked(robot, part, rng)
    before = [robot.world.part_pose(other).position_m for other in robot.parts if other is not part]
    progress = robot.run(Pick(robot.planner, seen, others))
    if progress.status is not SkillStatus.SUCCESS:
        return progress.reason
    after = [robot.world.part_pose(other).position_m for other in robot.parts if other is not part]
    moved_m = max(math.dist(a, b) for a, b in zip(before, after, strict=True))
    if moved_m > 0.0005:
        return f"a neighbour was moved by {moved_m * 1000:.1f} mm"
    opening_m, length_m = robot.observe().gripper.opening_m, robot.product.parts[part.part].size_m[0]
    if abs(opening_m - length_m) > 0.002:
        return f"the fingers hold {opening_m * 1000:.1f} mm, the length is {length_m * 1000:.1f} mm"
    for skill in (Place(robot.planner, position, part.part, others), MoveTo(robot.planner, "look")):
        progress = robot.run(skill)
        if progress.status is not SkillStatus.SUCCESS:
            return progress.reason
    return robot.seated(part, position)


def pick_beside_the_middle_and_place(
    robot: RobotAlone, monkeypatch: pytest.MonkeyPatch, hold: Hold, number: int, rng: np.random.Generator
) -> str | None:
    """As `pick_and_place`, a part being held in one way alone; seen as well as the detector sees."""
    monkeypatch.setattr("bracket_cell.skills.grasping.handling.ways_to_hold", lambda *_: iter([(hold, False)]))
    monkeypatch.setattr("tests.integration.test_pick_and_place.SIGMA_M", 0.0005)
    monkeypatch.setattr("tests.integration.test_pick_and_place.SIGMA_RAD", math.radians(0.3))
    position = robot.product.positions[int(rng.integers(6))]
    return pick_and_place(robot, robot.parts[number], position, rng)


def recover(robot: RobotAlone) -> None:
    """Let go and go back to where a cycle begins."""
    robot.act(Command(gripper=GripperCommand(0.085)))
    robot.wait(1.0)
    robot.run(MoveTo(robot.planner, "look"))


@pytest.mark.parametrize("number", range(3))
def test_each_type_is_picked_and_placed(robot: RobotAlone, number: int) -> None:
    rng = np.random.default_rng(number)
    assert pick_and_place(robot, robot.parts[number], "p2", rng) is None
    assert robot.clock.now_s() < 12.0


@pytest.mark.parametrize(("number", "position"), [(0, "p5"), (1, "p1")])
def test_a_part_between_others_is_taken_across_its_length_and_placed(
    robot: RobotAlone, number: int, position: str
) -> None:
    assert pick_across_the_length_and_place(robot, robot.parts[number], position, number) is None


@pytest.mark.slow
def test_60_parts_between_others_are_picked_and_placed(robot: RobotAlone) -> None:
    failures = []
    for seed in range(60):
        part = robot.parts[seed % 2]
        wrong = pick_across_the_length_and_place(robot, part, robot.product.positions[seed % 6], seed)
        print(f"{seed} {part.part}: {wrong or 'ok'}")
        if wrong is not None:
            failures.append(f"{seed} {part.part}: {wrong}")
            recover(robot)
        robot.put_away(part)
    assert len(failures) <= 0.03 * 60, failures


@pytest.mark.long
@pytest.mark.parametrize(("number", "grip"), BESIDE)
def test_each_type_is_taken_beside_its_middle_and_placed(
    robot: RobotAlone, monkeypatch: pytest.MonkeyPatch, number: int, grip: Grip
) -> None:
    """On one side of it or on the other; on both in the long test."""
    side = 1 + (number + (grip is Grip.LENGTH)) % 2
    hold, rng = Hold(grip, places_m(grip.axis)[-side]), np.random.default_rng(side)
    assert pick_beside_the_middle_and_place(robot, monkeypatch, hold, number, rng) is None


@pytest.mark.slow
@pytest.mark.parametrize(("number", "grip"), BESIDE)
def test_60_poses_are_taken_beside_the_middle_and_placed(
    robot: RobotAlone, monkeypatch: pytest.MonkeyPatch, number: int, grip: Grip
) -> None:
    rng, failures = np.random.default_rng(2), []
    for pose in range(60):
        beside = places_m(grip.axis)[1:]
        hold = Hold(grip, beside[pose % len(beside)])
        wrong = pick_beside_the_middle_and_place(robot, monkeypatch, hold, number, rng)
        robot.put_away(robot.parts[number])
        if wrong is not None:
            failures.append(f"{pose}: {wrong}")
            recover(robot)
    assert len(failures) <= 0.03 * 60, failures


@pytest.mark.slow
def test_150_poses_are_picked_and_placed(robot: RobotAlone) -> None:
    rng = np.random.default_rng(1)
    failures = []
    for number in range(50):
        for part in robot.parts:
            position = robot.product.positions[int(rng.integers(6))]
            start_s = robot.clock.now_s()
            wrong = pick_and_place(robot, part, position, rng)
            print(f"{number} {part.part} {position} {robot.clock.now_s() - start_s:.2f} s: {wrong or 'ok'}")
            robot.put_away(part)
            if wrong is not None:
                failures.append(f"{number} {part.part}: {wrong}")
                recover(robot)
    print(f"{150 - len(failures)} of 150")
    assert len(failures) <= 0.03 * 150, failures


def test_a_peg_finds_its_hole_although_the_part_was_seen_6_mm_off(robot: RobotAlone) -> None:
    part = robot.parts[1]
    robot.stand(part, (0.55, -0.40), 0.6)
    robot.wait(0.4)
    seen = robot.detection(part, np.random.default_rng(0), 0.0, 0.0)
    along = seen.world_from_part @ Pose((0.006, 0.0, 0.0))
    off = type(seen)(seen.part, 1.0, along, seen.size_m, seen.box_px)
    assert robot.run(Pick(robot.planner, off)).status is SkillStatus.SUCCESS
    assert robot.run(Place(robot.planner, "p4", part.part)).status is SkillStatus.SUCCESS
    assert robot.seated(part, "p4") is None


def test_a_part_that_is_not_there_is_not_held(robot: RobotAlone) -> None:
    part = robot.parts[0]
    robot.stand(part, (0.55, -0.40), 0.0)
    seen = robot.detection(part, np.random.default_rng(0), 0.0, 0.0)
    robot.put_away(part)
    progress = robot.run(Pick(robot.planner, seen))
    assert progress.status is SkillStatus.FAILURE
    assert "nothing between the fingers" in progress.reason


@pytest.mark.long
@pytest.mark.parametrize("number", [0, 1])
def test_a_part_held_by_its_ends_is_placed_between_filled_holes(robot: RobotAlone, number: int) -> None:
    part = robot.parts[number]
    neighbours = [other for other in robot.parts if other is not part]
    for other, position in zip(neighbours, ("p2", "p4"), strict=True):
        robot.world.place(other, hole_pose(robot.product, robot.bench, position))
    robot.stand(part, (0.55, -0.40), 0.4)
    robot.wait(0.4)
    seen = robot.detection(part, np.random.default_rng(0), 0.0, 0.0)
    width_m = robot.product.parts[part.part].size_m[1]
    phantom = replace(seen, world_from_part=seen.world_from_part @ Pose((0.0, width_m + 0.005, 0.0)))
    assert robot.run(Pick(robot.planner, seen, [phantom])).status is SkillStatus.SUCCESS
    before = [robot.world.part_pose(other).position_m for other in neighbours]
    assert robot.run(Place(robot.planner, "p3", part.part)).status is SkillStatus.SUCCESS
    assert robot.seated(part, "p3") is None
    after = [robot.world.part_pose(other).position_m for other in neighbours]
    np.testing.assert_allclose(after, before, atol=2e-4)


def test_fingers_that_meet_a_part_lying_unseen_stop_and_rise_again(robot: RobotAlone) -> None:
    wanted, unseen, _ = robot.parts
    robot.stand(wanted, (0.55, -0.40), 0.0)
    height_m = robot.bench.tray.centre_m[2] + robot.product.parts[unseen.part].size_m[1] / 2
    robot.world.place(unseen, Pose((0.55, -0.34, height_m), (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)))
    robot.wait(0.4)
    seen = robot.detection(wanted, np.random.default_rng(0), 0.0, 0.0)
    start_s = robot.clock.now_s()
    progress = robot.run(Pick(robot.planner, seen))
    assert progress.status is SkillStatus.FAILURE
    assert progress.reason == "the fingers met something on the way down to o1"
    assert robot.clock.now_s() - start_s < 3.0
    assert robot.run(MoveTo(robot.planner, "look", [seen])).status is SkillStatus.SUCCESS


def test_a_halt_in_mid_carry_stops_the_arm_and_keeps_the_part(robot: RobotAlone) -> None:
    part = robot.parts[2]
    robot.stand(part, (0.55, -0.40), 0.3)
    robot.wait(0.4)
    seen = robot.detection(part, np.random.default_rng(0), 0.0, 0.0)
    assert robot.run(Pick(robot.planner, seen)).status is SkillStatus.SUCCESS
    place = Place(robot.planner, "p1", part.part)
    for _ in range(12):
        command = Command()
        assert place.poll(robot.observe(), command).status is SkillStatus.RUNNING
        robot.act(command)
    assert robot.observe().arm.moving
    command = Command()
    place.halt(command)
    robot.act(command)
    robot.wait(0.6)
    stopped = robot.observe()
    robot.wait(0.4)
    later = robot.observe()
    assert not later.arm.moving
    assert np.allclose(stopped.arm.positions_rad, later.arm.positions_rad, atol=1e-3)
    assert later.gripper.holding
    assert robot.world.part_pose(part).position_m[2] > 0.1


def test_a_part_is_moved_aside_and_stands_clear(robot: RobotAlone) -> None:
    wanted, beside, blocker = robot.parts
    robot.stand(wanted, (0.55, -0.43), 0.0)
    robot.stand(beside, (0.55, -0.394), 0.0)
    robot.stand(blocker, (0.60, -0.43), math.pi / 2)
    robot.wait(0.4)
    rng = np.random.default_rng(0)
    seen = [robot.detection(part, rng, 0.0, 0.0) for part in robot.parts]
    refused = robot.run(Pick(robot.planner, seen[0], seen[1:]))
    assert "no room for the fingers" in refused.reason
    progress = robot.run(MoveAside(robot.planner, seen[2], seen[:2]))
    assert progress.status is SkillStatus.SUCCESS, progress.reason
    robot.wait(0.4)
    pose = robot.world.part_pose(blocker)
    assert math.dist(pose.position_m[:2], (0.55, -0.43)) > 0.08
    assert pose.rotation[2, 2] > 0.999
    others = [seen[1], robot.detection(blocker, rng, 0.0, 0.0)]
    assert robot.run(Pick(robot.planner, seen[0], others)).status is SkillStatus.SUCCESS


def test_the_same_cycle_twice_is_the_same_bit_for_bit() -> None:
    ends = []
    for run in range(2):
        with RobotAlone(TYPES, f"twice {run}") as robot:
            robot.run(MoveTo(robot.planner, "look"))
            pick_and_place(robot, robot.parts[0], "p3", np.random.default_rng(5))
            ends.append((robot.tick, robot.observe().arm.positions_rad, robot.world.part_pose(robot.parts[0])))
    assert ends[0] == ends[1]
