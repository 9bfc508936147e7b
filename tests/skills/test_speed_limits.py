"""Shares of a path's speed that a safety configuration leaves: they keep to it, and are no lower than needed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bracket_cell.configuration import load_configuration
from bracket_cell.skills.drivers.speed_limits import KEPT, STEP_S, SpeedLimits, share_at
from bracket_cell.skills.motion.kinematics import Kinematics
from bracket_ground.interfaces.command import JointTrajectory
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.robot import MotionLimits, RobotModel, SafetyLimits, complete, load_robot
from tests.arms import robot_file

ROBOT = load_configuration().robot
WAY_RAD = np.array([1.2, 0.5, -0.7, 0.3, 0.2, 2.0])


def path() -> JointTrajectory:
    """A second and a half from rest to rest."""
    part = np.linspace(0.0, 1.0, 76)
    return JointTrajectory(1.5 * part, np.array(ROBOT.home_rad) + np.outer(part**2 * (3 - 2 * part), WAY_RAD))


def shares(limits: MotionLimits) -> np.ndarray:
    """In normal mode."""
    robot = ROBOT.model_copy(update={"safety": SafetyLimits(normal=limits)})
    return SpeedLimits(robot).shares(path())["normal"]


def test_without_limits_a_path_keeps_its_speed() -> None:
    assert (shares(MotionLimits()) == 1.0).all()


def test_the_tool_keeps_to_its_limit_and_uses_it() -> None:
    found, kinematics = shares(MotionLimits(tool_m_s=0.5)), Kinematics()
    marks_s: Array = np.arange(len(found), dtype=np.float64) * STEP_S
    places_m = np.array([kinematics.position_m(joints) for joints in path().along(marks_s)])
    fast = np.linalg.norm(np.gradient(places_m, STEP_S, axis=0), axis=1)
    assert fast.max() > 1.0
    assert (fast * found)[fast > 0.6] == pytest.approx(0.5 * KEPT, rel=0.02)
    assert (found[fast < 0.5 * KEPT * 0.98] == 1.0).all()


def test_a_joint_keeps_to_its_own_limit() -> None:
    found = shares(MotionLimits(joint_rad_s=(9, 9, 9, 9, 9, 0.5)))
    assert found.min() == pytest.approx(0.5 * KEPT / (1.5 * WAY_RAD[5] / 1.5), rel=0.02)


@pytest.mark.parametrize("limits", [MotionLimits(elbow_m_s=0.1), MotionLimits(momentum_kg_m_s=3.0)])
def test_elbow_and_momentum_slow_a_path_down(limits: MotionLimits) -> None:
    found = shares(limits)
    assert 0.05 < found.min() < 0.9
    assert found[0] == found[-1] == 1.0


def test_reduced_mode_has_the_speed_of_the_standard_where_nothing_is_given() -> None:
    limited = SpeedLimits(ROBOT).shares(path())
    assert limited["normal"].min() == 1.0
    assert limited["reduced"].min() < 0.25


def test_an_arm_slows_down_before_the_place_that_asks_for_it() -> None:
    found = np.array([1.0] * 60 + [0.3] * 5 + [1.0] * 80)
    assert [share_at(found, at_s) for at_s in (0.0, 0.25, 1.29, 1.31)] == [1.0, 0.3, 0.3, 1.0]


def test_a_limit_of_another_count_of_joints_is_refused() -> None:
    wrong = SafetyLimits.model_validate({"reduced": {"joint_rad_s": [1.0, 1.0]}})
    robot = RobotModel.model_validate({**dict(ROBOT), "safety": wrong})
    with pytest.raises(ValueError, match=r"safety.reduced.joint_rad_s has 2 values, the arm has 6 joints"):
        complete(robot)


def test_a_limit_of_momentum_needs_masses(tmp_path: Path) -> None:
    robot_file(tmp_path, "seven")  # a drawing without any
    robot = load_robot("seven.yaml", tmp_path)
    limits = SafetyLimits(normal=MotionLimits(momentum_kg_m_s=10.0))
    with pytest.raises(ValueError, match=r"^seven\.yaml: safety: momentum_kg_m_s, and the URDF has no masses"):
        complete(robot.model_copy(update={"safety": limits}), "seven.yaml")
