"""Arms of any number of joints, mounted anywhere: forward and inverse agree, limits are kept, a way is found."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.skills.motion.grasp_pose import tool_down
from bracket_cell.skills.motion.kinematics import Kinematics
from bracket_cell.skills.motion.planner import Load, MotionPlanner
from bracket_cell.skills.motion.resting import _first
from bracket_cell.skills.motion.settings import MotionSettings
from bracket_ground.interfaces.pose import FINGERS_DOWN
from bracket_ground.interfaces.robot import FOLDER, RobotModel, load_robot
from tests.arms import DRAWN, cell_file, robot_file

MOUNTS = {
    "turned": "mount: {position_m: [0.3, -0.2, 0.0], quaternion_wxyz: [0.7071068, 0, 0, 0.7071068]}\n",
    "on a pedestal": "mount: {position_m: [0, 0, 0.25]}\n",
    "on the ceiling": "mount: {position_m: [0.5, 0, 1.1], quaternion_wxyz: [0, 1, 0, 0]}\n",
    "on a wall": "mount: {position_m: [-0.1, 0, 0.5], quaternion_wxyz: [0.7071068, 0, 0.7071068, 0]}\n",
}


def places(count: int) -> np.ndarray:
    rng = np.random.default_rng(7)
    return rng.uniform((0.35, -0.35, 0.05, -3.0), (0.6, 0.35, 0.25, 3.0), (count, 4))


def reached(robot: RobotModel, count: int = 60) -> int:
    """How many places are reached; those that are not, no other of 60 postures leads to either."""
    arm, rng = Kinematics(MotionSettings().of(robot)), np.random.default_rng(1)
    least, most = np.maximum(arm.limits_rad[0], -3), np.minimum(arm.limits_rad[1], 3)
    found = 0
    for x, y, z, yaw in places(count):
        pose = tool_down((x, y, z), yaw)
        if (joints := arm.inverse(pose)) is not None:
            found += 1
            np.testing.assert_allclose(arm.forward(joints).matrix, pose.matrix, atol=1e-5)
            assert robot.within(joints).all()
        else:
            assert all(arm.solved(pose, rng.uniform(least, most)) is None for _ in range(60))
    return found


@pytest.mark.parametrize("name", DRAWN)
def test_arms_of_any_count_reach_a_bench(name: str, tmp_path: Path) -> None:
    robot = load_robot(robot_file(tmp_path, name).name, tmp_path)
    assert len(robot.joints) == len(DRAWN[name].rows)
    assert reached(robot) >= 50


@pytest.mark.long
@pytest.mark.parametrize("where", MOUNTS)
def test_an_arm_reaches_from_where_it_is_mounted(where: str, tmp_path: Path) -> None:
    text = (FOLDER / "ur10.yaml").read_text()
    home = next(line for line in text.splitlines() if line.startswith("home_rad"))
    (tmp_path / "mounted.yaml").write_text(text.replace(home, "") + MOUNTS[where])
    assert reached(load_robot("mounted.yaml", tmp_path)) >= 35


def test_the_shipped_arm_needs_no_posture_to_begin_from(tmp_path: Path) -> None:
    text = (FOLDER / "ur10.yaml").read_text()
    (tmp_path / "a.yaml").write_text("\n".join(line for line in text.splitlines() if not line.startswith("home_rad")))
    assert reached(load_robot("a.yaml", tmp_path)) == 60


@pytest.mark.parametrize("name", DRAWN)
def test_resting_poses_are_found_and_a_way_between_them(name: str, tmp_path: Path) -> None:
    robot_file(tmp_path, name)
    path = cell_file(tmp_path, f"{name}.yaml")
    cell = load_configuration(path)
    planner = MotionPlanner(load_product(cell, path), cell.bench, cell.motion)
    assert planner.blocked == []
    look, park = (np.array(joints) for joints in (cell.bench.arm_look_rad, cell.bench.arm_park_rad))
    way = planner.free_move(park, look, Load(0.085))
    assert not isinstance(way, str)
    assert way.positions_rad.shape[1] == len(look)
    speeds = np.abs(np.diff(way.positions_rad, axis=0)).max(axis=0) / 0.008
    assert (speeds <= np.array(cell.robot.speed_rad_s) * 1.01).all()


def test_a_pose_that_is_found_at_a_limit_is_no_farther_than_that() -> None:
    """Pi to four decimals is more than pi."""
    limits_rad, joints = np.array([[-np.pi, -2.0], [np.pi, 2.0]]), np.array([np.pi, 0.123456])
    arm = SimpleNamespace(usual_rad=joints, limits_rad=limits_rad)
    planner: Any = SimpleNamespace(kinematics=arm, open_m=0.0, reach=lambda *_: (FINGERS_DOWN, joints))
    assert _first(planner, iter([FINGERS_DOWN]), "look") == (np.pi, 0.1235)


def test_a_way_around_a_post_is_found_for_seven_joints(tmp_path: Path) -> None:
    robot_file(tmp_path, "seven")
    path = cell_file(tmp_path, "seven.yaml")
    text = path.read_text().replace(
        "  bins_m:",
        "  obstacles:\n    - {name: the post, position_m: [0.45, -0.1, 0.2], box_m: [0.1, 0.03, 0.4]}\n  bins_m:",
    )
    path.write_text(text)
    cell = load_configuration(path)
    planner = MotionPlanner(load_product(cell, path), cell.bench, cell.motion)
    load, near = Load(0.085), np.array(cell.bench.arm_look_rad)
    ends = [planner.reach([tool_down((0.45, y, 0.12), 0.0)], near, load) for y in (-0.3, 0.12)]
    first, second = (found[1] for found in ends if not isinstance(found, str))
    assert not planner.scene(load).is_free(np.array([first, second]))
    way = planner.free_move(first, second, load)
    assert not isinstance(way, str), way
    assert planner.scene(load).is_free(way.positions_rad)
