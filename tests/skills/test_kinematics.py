"""Laws of the kinematics: forward of inverse is the identity, elbow up, turns within the limits."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bracket_cell.skills.motion.grasp_pose import tool_down
from bracket_cell.skills.motion.kinematics import Kinematics
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.robot import default_robot


def random_target(rng: np.random.Generator) -> Pose:
    position = (rng.uniform(0.3, 0.95), rng.uniform(-0.6, 0.6), rng.uniform(0.005, 0.4))
    return tool_down(position, rng.uniform(-math.pi, math.pi))


@pytest.mark.parametrize("seed", range(5))
def test_forward_of_inverse_is_the_identity(kinematics: Kinematics, seed: int) -> None:
    rng = np.random.default_rng(seed)
    for _ in range(40):
        target = random_target(rng)
        joints = kinematics.inverse(target)
        assert joints is not None
        assert kinematics.within_limits(joints)
        assert joints[2] > 0
        np.testing.assert_allclose(kinematics.forward(joints).matrix, target.matrix, atol=6e-4)
        np.testing.assert_allclose(kinematics.forward(joints).position_m, target.position_m, atol=6e-5)


def test_inverse_does_not_depend_on_what_was_asked_before(kinematics: Kinematics) -> None:
    rng = np.random.default_rng(3)
    targets = [random_target(rng) for _ in range(10)]
    first = [kinematics.inverse(target) for target in targets]
    second = [kinematics.inverse(target) for target in reversed(targets)]
    for one, other in zip(first, reversed(second), strict=True):
        assert one is not None
        assert other is not None
        assert np.array_equal(one, other)


@pytest.mark.parametrize("position", [(1.6, 0.0, 0.2), (0.0, 0.0, 2.0), (0.1, 0.05, 0.02)])
def test_out_of_reach_is_none(kinematics: Kinematics, position: tuple[float, float, float]) -> None:
    assert kinematics.inverse(tool_down(position, 0.0)) is None


def test_answer_is_wrapped_towards_where_the_arm_is(kinematics: Kinematics) -> None:
    near = np.array([0.0, -1.3, 1.9, -2.1, -1.5, 5.0])
    joints = kinematics.inverse(tool_down((0.6, 0.1, 0.1), 0.3), near)
    assert joints is not None
    assert abs(joints[5] - near[5]) <= math.pi + 1e-6


def test_wrapping_keeps_the_pose_and_the_limits(kinematics: Kinematics) -> None:
    rng, (low, high) = np.random.default_rng(0), default_robot().limits_rad
    for _ in range(200):
        joints, near = rng.uniform(low, high), rng.uniform(low, high)
        turned = kinematics.wrapped(joints, near)
        assert kinematics.within_limits(turned)
        turns = (turned - joints) / (2 * math.pi)
        np.testing.assert_allclose(turns, np.round(turns), atol=1e-12)


def test_tcp_lies_beyond_the_flange(kinematics: Kinematics) -> None:
    # Stretched out along x: shoulder height, both links, the wrist's offsets and the tool (UR10 datasheet lengths).
    tool = kinematics.forward(np.zeros(6))
    np.testing.assert_allclose(tool.position_m, (0.612 + 0.5723, 0.1639 + 0.0922 + 0.156, 0.1273 - 0.1157), atol=2e-4)


def test_where_the_tool_is_can_be_asked_alone(kinematics: Kinematics) -> None:
    rng = np.random.default_rng(4)
    for joints in rng.uniform(-2, 2, (20, 6)):
        np.testing.assert_allclose(kinematics.position_m(joints), kinematics.forward(joints).position_m, atol=1e-12)


def test_neighbouring_points_have_neighbouring_joints(kinematics: Kinematics) -> None:
    joints = kinematics.inverse(tool_down((0.6, -0.3, 0.3), 1.0))
    assert joints is not None
    for step in range(1, 50):
        following = kinematics.follow(tool_down((0.6, -0.3, 0.3 - 0.005 * step), 1.0), joints)
        assert following is not None
        assert np.abs(following - joints).max() < 0.05
        joints = following
