"""Laws of trajectories: they start and end where asked, at rest, and keep the datasheet's limits."""

from __future__ import annotations

import math
from functools import reduce
from itertools import pairwise

import numpy as np
import pytest

from bracket_cell.skills.motion.grasp_pose import tool_down
from bracket_cell.skills.motion.kinematics import Kinematics
from bracket_cell.skills.motion.settings import MotionSettings
from bracket_cell.skills.motion.trajectory import joined, joint_move, joint_speeds, line_move, rounded
from bracket_ground.interfaces.command import JointTrajectory
from bracket_ground.interfaces.pose import Array

SETTINGS = MotionSettings()
DATASHEET_RAD_S = np.radians([120.0, 120.0, 180.0, 180.0, 180.0, 180.0])
LOW: Array = np.array([-1.5, -2.0, 0.8, -2.5, -1.6, -3.0])
HIGH: Array = np.array([1.0, -0.7, 2.6, -1.4, -1.5, 3.0])


def assert_legal(trajectory: JointTrajectory) -> None:
    speeds = joint_speeds(trajectory.times_s, trajectory.positions_rad)
    assert (np.abs(speeds) <= DATASHEET_RAD_S).all()
    accelerations = np.diff(speeds, axis=0) / SETTINGS.sample_s
    assert (np.abs(accelerations) <= np.array(SETTINGS.acceleration_limits_rad_s2) * 1.01).all()
    jerks = np.diff(accelerations, axis=0) / SETTINGS.sample_s
    assert (np.abs(jerks) <= np.array(SETTINGS.jerk_limits_rad_s3) * 1.01).all()
    assert np.abs(speeds[[0, -1]]).max() < 0.02
    np.testing.assert_allclose(np.diff(trajectory.times_s), SETTINGS.sample_s)


def test_the_defaults_keep_the_datasheet() -> None:
    assert (np.array(SETTINGS.speed_limits_rad_s) <= DATASHEET_RAD_S).all()


@pytest.mark.parametrize("seed", range(20))
def test_joint_moves_are_legal_and_straight(seed: int) -> None:
    rng = np.random.default_rng(seed)
    start, goal = rng.uniform(LOW, HIGH), rng.uniform(LOW, HIGH)
    trajectory = joint_move(start, goal, SETTINGS)
    assert_legal(trajectory)
    np.testing.assert_allclose(trajectory.positions_rad[0], start, atol=1e-12)
    assert np.array_equal(trajectory.positions_rad[-1], goal)
    shares = (trajectory.positions_rad - start) / (goal - start)
    np.testing.assert_allclose(shares, shares[:, :1] @ np.ones((1, 6)), atol=1e-6)


@pytest.mark.parametrize("seed", range(20))
def test_ways_are_rounded_within_the_limits_of_jerk_and_not_slower_than_with_stops(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.uniform(LOW, HIGH, (4, 6))
    legs = [joint_move(first, second, SETTINGS) for first, second in pairwise(points)]
    whole = reduce(lambda way, leg: rounded(way, leg, SETTINGS, lambda _: True)[0], legs)
    assert_legal(whole)
    np.testing.assert_allclose(whole.positions_rad[[0, -1]], points[[0, -1]], atol=1e-9)
    assert whole.duration_s < joined(legs).duration_s - 0.1


def test_a_move_to_where_the_arm_is_takes_no_time() -> None:
    assert joint_move(LOW, LOW, SETTINGS).duration_s == 0


@pytest.mark.parametrize("seed", range(6))
def test_lines_are_legal_and_straight_for_the_tool(kinematics: Kinematics, seed: int) -> None:
    rng = np.random.default_rng(seed)
    x, y, yaw = rng.uniform(0.4, 0.8), rng.uniform(-0.5, 0.4), rng.uniform(-math.pi, math.pi)
    start = kinematics.inverse(tool_down((x, y, 0.30), yaw))
    assert start is not None
    goal = tool_down((x, y, 0.06), yaw)
    trajectory = line_move(kinematics, start, goal, SETTINGS)
    assert trajectory is not None
    assert_legal(trajectory)
    poses = [kinematics.forward(joints) for joints in trajectory.positions_rad]
    positions = np.array([pose.position_m for pose in poses])
    assert np.abs(positions[:, :2] - (x, y)).max() < 2e-4
    assert (np.diff(positions[:, 2]) <= 1e-4).all()
    np.testing.assert_allclose(poses[-1].matrix, goal.matrix, atol=6e-4)


def test_fast_lines_are_slowed_down_to_the_joint_limits(kinematics: Kinematics) -> None:
    hasty = SETTINGS.model_copy(
        update={"line_speed_m_s": 3.0, "line_acceleration_m_s2": 30.0, "line_jerk_m_s3": 1000.0}
    )
    start = kinematics.inverse(tool_down((0.45, -0.35, 0.2), 0.0))
    assert start is not None
    trajectory = line_move(kinematics, start, tool_down((0.75, 0.25, 0.2), 0.0), hasty)
    assert trajectory is not None
    assert_legal(trajectory)


def test_a_line_out_of_reach_is_none(kinematics: Kinematics) -> None:
    start = kinematics.inverse(tool_down((0.8, 0.0, 0.2), 0.0))
    assert start is not None
    assert line_move(kinematics, start, tool_down((1.5, 0.0, 0.2), 0.0), SETTINGS) is None
