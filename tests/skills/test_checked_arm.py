"""The checks in front of every arm: what it cannot or must not follow never reaches its driver."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cell.errors import DeviceFault
from cell.interfaces.clock import ManualClock
from cell.interfaces.command import JointTrajectory
from cell.interfaces.robot import default_robot
from skills.drivers.checked_arm import CheckedArm
from tests.cell.fakes import FakeArm

UR10 = default_robot()


def driver() -> FakeArm:
    return FakeArm(ManualClock())


def test_what_can_be_followed_reaches_the_driver() -> None:
    arm = driver()
    start = np.array(arm.state().positions_rad)
    trajectory = JointTrajectory(np.array([0.0, 0.1]), np.array([start, start + 0.1 * np.array(UR10.speed_rad_s)]))
    assert CheckedArm(arm, UR10).follow(trajectory) is trajectory
    assert arm.calls == ["follow"]


@pytest.mark.parametrize(
    ("offset_rad", "goal_rad", "times_s", "reason"),
    [
        (0.06, 0.0, (0.0, 1.0), "starts 0.060 rad from where shoulder_pan is"),
        (0.0, 7.0, (0.0, 9.0), "leaves the range of shoulder_pan"),
        (0.0, 1.0, (0.0, 0.2), "moves shoulder_pan at .* limit 2.09"),
        (0.0, math.nan, (0.0, 1.0), "not finite"),
        (0.0, 0.0, (0.0, math.inf), "not finite"),
        (0.0, 0.0, (0.0, 0.0), "do not increase"),
    ],
)
def test_what_cannot_be_followed_does_not(
    offset_rad: float, goal_rad: float, times_s: tuple[float, float], reason: str
) -> None:
    arm = driver()
    start = np.array(arm.state().positions_rad)
    path = np.array([start, start])
    path[0, 0] += offset_rad
    path[1, 0] += goal_rad
    with pytest.raises(DeviceFault, match=reason):
        CheckedArm(arm, UR10).follow(JointTrajectory(np.array(times_s), path))
    assert arm.calls == []


@pytest.mark.parametrize(("asked", "sent"), [(0.4, 0.4), (2.0, 1.0), (-1.0, 0.0), (math.nan, 0.0), (math.inf, 0.0)])
def test_a_share_of_speed_is_from_0_to_1(asked: float, sent: float) -> None:
    arm = driver()
    CheckedArm(arm, UR10).pace(asked)
    assert arm.shares == [sent]
