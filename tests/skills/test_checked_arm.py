"""The checks in front of every arm: what it cannot or must not follow never reaches its driver."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bracket_cell.skills.drivers.checked_arm import CheckedArm
from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.clock import ManualClock
from bracket_ground.interfaces.command import JointTrajectory
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.robot import default_robot
from tests.cell.fakes import FakeArm

UR10 = default_robot()


def driver() -> FakeArm:
    return FakeArm(ManualClock())


def swing(span_rad: float = 0.4, lasts_s: float = 1.2) -> JointTrajectory:
    """The base turns from rest to rest."""
    times_s: Array = np.linspace(0.0, lasts_s, 151)
    path = np.zeros((151, 6))
    path[:, 0] = span_rad * (1 - np.cos(np.pi * times_s / lasts_s)) / 2
    return JointTrajectory(times_s, path)


def test_what_can_be_followed_reaches_the_driver() -> None:
    arm = driver()
    trajectory = swing()
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


def ramp(speeds_rad_s: np.ndarray) -> JointTrajectory:
    """The base at these speeds, 8 ms each."""
    path = np.zeros((len(speeds_rad_s) + 1, 6))
    path[1:, 0] = np.cumsum(speeds_rad_s) * 0.008
    times_s: Array = 0.008 * np.arange(len(path), dtype=np.float64)
    return JointTrajectory(times_s, path)


SPEEDS_RAD_S = np.concatenate([np.linspace(0, 2, 80), np.linspace(2, 0, 80)])
BACK_RAD_S = np.concatenate([np.linspace(0, 2, 80), np.linspace(-2, 0, 80)])


@pytest.mark.parametrize(
    ("trajectory", "reason"),
    [
        (ramp(SPEEDS_RAD_S[40:]), "at its beginning"),
        (ramp(SPEEDS_RAD_S[:-40]), "at its end"),
        (ramp(BACK_RAD_S), "changes the speed of shoulder_pan by .* at 0.64 s, limit 5.00"),
        (swing(lasts_s=0.4), "limit 5.00 rad/s2"),
        (JointTrajectory(np.array([0.0, 1.0]), np.array([[0.0] * 6, [2.0] + [0.0] * 5])), "rad/s2"),
        (JointTrajectory(swing().times_s + 100, swing().positions_rad), "begins at 100 s, must begin at 0"),
        (JointTrajectory(swing().times_s - 5, swing().positions_rad), "begins at -5 s"),
    ],
)
def test_a_trajectory_begins_and_ends_at_rest_at_time_0_within_accelerations(
    trajectory: JointTrajectory, reason: str
) -> None:
    arm = driver()
    with pytest.raises(DeviceFault, match=reason):
        CheckedArm(arm, UR10).follow(trajectory)
    assert arm.calls == []


def test_an_arm_that_tells_five_joints_follows_nothing() -> None:
    arm = driver()
    arm.positions_rad = (0.0,) * 5
    with pytest.raises(DeviceFault, match="tells 5 joints, must be 6"):
        CheckedArm(arm, UR10).follow(swing())


class Loadable(FakeArm):
    """An arm that must know its load."""

    def carry(self, held: bool) -> None:
        self.calls.append(f"carry {held}")


def test_an_arm_that_must_know_its_load_is_told_and_others_are_not() -> None:
    loaded, plain = Loadable(ManualClock()), driver()
    for arm in (loaded, plain):
        CheckedArm(arm, UR10).carry(True)
    assert (loaded.calls, plain.calls) == (["carry True"], [])
