"""Motions that a tree file gives, on the simulated robot: lines, contact, spots."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest

from bracket_cell.skills.grasping.phases import MoveFingers
from bracket_cell.skills.grasping.straight import MoveUntilContact, StraightMove
from bracket_cell.skills.motion.grasp_pose import tool_down
from bracket_cell.skills.move_to import MoveTo, MoveToJoints, MoveToPose
from bracket_cell.skills.pick_and_place import Pick
from bracket_cell.skills.put_down import PutDown
from bracket_ground.interfaces.command import GripperCommand
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.skill import SkillStatus
from tests.integration.robot_alone import RobotAlone


@pytest.fixture
def robot(request: pytest.FixtureRequest) -> Iterator[RobotAlone]:
    with RobotAlone(("o2",), request.node.name) as robot:
        assert robot.run(MoveTo(robot.planner, "look")).status is SkillStatus.SUCCESS
        yield robot


def tool(robot: RobotAlone) -> Pose:
    return robot.planner.kinematics.forward(np.array(robot.observe().arm.positions_rad))


def test_the_tool_goes_to_poses_along_lines_and_to_joints(robot: RobotAlone) -> None:
    above = tool_down((0.50, -0.30, 0.25), math.radians(30))
    assert robot.run(MoveToPose(robot.planner, "there", world_from_tool=above)).status is SkillStatus.SUCCESS
    assert math.dist(tool(robot).position_m, above.position_m) < 0.004
    below = tool_down((0.56, -0.36, 0.15), math.radians(30))
    began_s = robot.clock.now_s()
    assert robot.run(StraightMove(robot.planner, below, "there", 0.05)).status is SkillStatus.SUCCESS
    assert math.dist(tool(robot).position_m, below.position_m) < 0.004
    assert robot.clock.now_s() - began_s > math.dist(above.position_m, below.position_m) / 0.05
    park = np.array(robot.bench.arm_park_rad)
    assert robot.run(MoveToJoints(robot.planner, joints_rad=park)).status is SkillStatus.SUCCESS
    far = tool_down((3.0, 0.0, 0.2), 0.0)
    progress = robot.run(MoveToPose(robot.planner, "world: 3 0 0.2", world_from_tool=far))
    assert (progress.status, progress.reason) == (
        SkillStatus.FAILURE,
        "cannot move to world: 3 0 0.2: out of the arm's reach",
    )


def test_the_tool_stops_where_it_meets_the_tray_and_not_in_the_air(robot: RobotAlone) -> None:
    above = tool_down((0.56, -0.36, 0.06), 0.0)
    closed = MoveFingers(robot.planner.settings, GripperCommand(0.0), "closing the fingers")
    assert robot.run(closed).status is SkillStatus.SUCCESS
    assert robot.run(MoveToPose(robot.planner, "there", world_from_tool=above)).status is SkillStatus.SUCCESS
    progress = robot.run(MoveUntilContact(robot.planner, np.array([0.0, 0.0, -0.02]), 0.02))
    assert (progress.status, progress.reason) == (SkillStatus.FAILURE, "nothing was met on the whole way")
    progress = robot.run(MoveUntilContact(robot.planner, np.array([0.0, 0.0, -0.08]), 0.02))
    assert progress.status is SkillStatus.SUCCESS, progress.reason
    robot.wait(0.4)
    tip_m = tool(robot).position_m[2] - robot.planner.settings.robot.gripper.fingertip_beyond_tcp_m
    assert abs(tip_m - robot.bench.tray.centre_m[2]) < 0.006


def test_a_part_is_put_down_on_a_spot_of_the_table(robot: RobotAlone) -> None:
    part = robot.parts[0]
    robot.stand(part, (0.55, -0.35), 0.4)
    robot.wait(0.4)
    seen = robot.detection(part, np.random.default_rng(0), 0.001, math.radians(1.0))
    assert robot.run(Pick(robot.planner, seen)).status is SkillStatus.SUCCESS
    spot = Pose.from_yaw((0.40, 0.50, 0.0), math.radians(90))
    assert robot.run(PutDown(robot.planner, "o2", spot, "there")).status is SkillStatus.SUCCESS
    robot.wait(0.4)
    pose = robot.world.part_pose(part)
    assert math.dist(pose.position_m[:2], spot.position_m[:2]) < 0.006
    assert abs(math.sin(pose.yaw_rad - math.radians(90))) < 0.1
    empty = robot.run(PutDown(robot.planner, "o2", spot, "there"))
    assert (empty.status, empty.reason) == (SkillStatus.FAILURE, "cannot put o2 down: the gripper holds nothing")
