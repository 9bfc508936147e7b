"""What the collision checker must see, and what it must let pass."""

from __future__ import annotations

import numpy as np
import pytest

from cell.interfaces.bench import Bench
from cell.interfaces.pose import Array, Pose
from cell.interfaces.product import Product
from skills.motion.collision import Box, CollisionChecker, body_box, resampled
from skills.motion.grasp_pose import held_boxes, tool_down
from skills.motion.grip import Grip, Hold
from skills.motion.kinematics import Kinematics
from skills.motion.settings import MotionSettings

SETTINGS = MotionSettings()


@pytest.fixture(scope="module")
def checker(kinematics: Kinematics, product: Product, bench: Bench) -> CollisionChecker:
    return CollisionChecker(kinematics, product, bench)


def at(kinematics: Kinematics, x: float, y: float, z: float, yaw: float = 0.0) -> Array:
    joints = kinematics.inverse(tool_down((x, y, z), yaw))
    assert joints is not None
    return joints[None]


def test_named_poses_and_the_way_between_them_are_free(checker: CollisionChecker, bench: Bench) -> None:
    way = np.array([bench.arm_park_rad, bench.arm_look_rad])
    assert checker.first_contact(way, 0.085, margin_m=0.01) is None


@pytest.mark.parametrize(
    ("spot", "touched"),
    [
        ((0.30, 0.30, 0.005), "the table"),
        ((0.56, -0.38, 0.010), "the tray"),
        ((0.72, 0.14, 0.040), "the bracket"),
        ((0.56, -0.58, 0.018), "the tray's rim"),
    ],
)
def test_what_stands_on_the_bench_is_seen(
    checker: CollisionChecker, kinematics: Kinematics, spot: tuple[float, float, float], touched: str
) -> None:
    contact = checker.first_contact(at(kinematics, *spot), 0.04)
    assert contact is not None
    assert touched in contact


def test_fingers_pass_closely_over_what_they_must_not_touch(checker: CollisionChecker, kinematics: Kinematics) -> None:
    tip = SETTINGS.robot.tool.fingertip_beyond_tcp_m
    assert checker.first_contact(at(kinematics, 0.72, 0.14, 0.036 + tip + 0.002), 0.05) is None
    assert checker.first_contact(at(kinematics, 0.72, 0.14, 0.036 + tip - 0.002), 0.05) is not None


def test_the_opening_decides_about_neighbours(checker: CollisionChecker, kinematics: Kinematics) -> None:
    wall = Box("a neighbour", Pose((0.55 + 0.045, -0.40, 0.03)), (0.01, 0.1, 0.05))
    joints = at(kinematics, 0.55, -0.40, 0.04)
    assert checker.first_contact(joints, 0.030, [wall]) is None
    assert checker.first_contact(joints, 0.080, [wall]) is not None
    turned = at(kinematics, 0.55, -0.40, 0.04, np.pi / 2)
    assert checker.first_contact(turned, 0.080, [wall]) is None


def test_the_margin_counts(checker: CollisionChecker, kinematics: Kinematics) -> None:
    box = Box("a box", Pose((0.55, -0.40, 0.05)), (0.05, 0.05, 0.05))
    above = at(kinematics, 0.55, -0.40, 0.075 + SETTINGS.robot.tool.fingertip_beyond_tcp_m + 0.003)
    assert checker.first_contact(above, 0.01, [box], margin_m=0.001) is None
    assert checker.first_contact(above, 0.01, [box], margin_m=0.006) is not None


def test_a_held_part_is_carried_along(checker: CollisionChecker, kinematics: Kinematics, product: Product) -> None:
    kind = product.parts["o3"]
    standing = body_box("o2 at p3", Pose((0.72, 0.18, 0.036)), product.parts["o2"].size_m)
    bottom_m = 0.036 + product.parts["o2"].size_m[2] + kind.peg_length_m / 2
    joints = at(kinematics, 0.72, 0.18, bottom_m + kind.size_m[2] - SETTINGS.grasp_depth_m + 0.008)
    assert checker.first_contact(joints, 0.04, [standing]) is None
    body = held_boxes("o3", kind, SETTINGS, Hold(Grip.WIDTH), with_peg=False)
    assert checker.first_contact(joints, 0.04, [standing], body) is None
    with_peg = held_boxes("o3", kind, SETTINGS, Hold(Grip.WIDTH), with_peg=True)
    contact = checker.first_contact(joints, 0.04, [standing], with_peg)
    assert contact is not None
    assert "o3 in the gripper" in contact
    assert "o2 at p3" in contact


def test_an_obstacle_in_mid_path_is_not_stepped_over(checker: CollisionChecker, kinematics: Kinematics) -> None:
    path = np.vstack([at(kinematics, 0.6, -0.3, 0.2), at(kinematics, 0.6, 0.3, 0.2)])
    post = Box("a post", Pose((0.67, 0.02, 0.10)), (0.03, 0.03, 0.20))
    assert checker.first_contact(path, 0.0) is None
    assert checker.first_contact(path, 0.0, [post]) is not None
    assert checker.first_contact(path[::-1], 0.0, [post]) is not None


def test_the_arm_does_not_meet_itself_unnoticed(checker: CollisionChecker) -> None:
    folded: Array = np.array([[0.0, -1.0, 3.1, -1.5, 1.5, 0.0]])
    assert checker.first_contact(folded, 0.04) is not None


def test_resampling_keeps_the_ends_and_the_step() -> None:
    path: Array = np.array([[0.0] * 6, [0.5, 0, 0, 0, 0, 0], [0.5, -1.0, 0.2, 0, 0, 0]])
    dense = resampled(path, 0.02)
    assert np.array_equal(dense[[0, -1]], path[[0, -1]])
    assert np.abs(np.diff(dense, axis=0)).max() <= 0.02 + 1e-12
