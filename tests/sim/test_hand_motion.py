"""Laws of reaches: they end where they should, at rest, and never too fast."""

from __future__ import annotations

import numpy as np
import pytest

from bracket_ground.interfaces.pose import Array
from bracket_sim.scene.hand_motion import MotionSettings, min_jerk, plan_reach

START_M = np.array([1.0, 0.4, 0.1])
END_M = np.array([0.7, -0.1, 0.2])


def reach_positions(seed: int, end_m: Array = END_M, arch_m: float = 0.04) -> tuple[float, Array]:
    reach = plan_reach(START_M, end_m, MotionSettings(), np.random.default_rng(seed), arch_m=arch_m)
    times_s = np.linspace(0.0, reach.duration_s, 500)
    return reach.duration_s, np.array([reach.at(time_s) for time_s in times_s])


def test_min_jerk_is_symmetric() -> None:
    assert min_jerk(0.0) == 0.0
    assert min_jerk(0.5) == pytest.approx(0.5)
    assert min_jerk(0.3) + min_jerk(0.7) == pytest.approx(1.0)


@pytest.mark.parametrize("seed", range(5))
def test_reach_begins_and_ends_where_asked(seed: int) -> None:
    _, positions = reach_positions(seed)
    assert positions[0] == pytest.approx(START_M)
    assert positions[-1] == pytest.approx(END_M)


@pytest.mark.parametrize("seed", range(20))
def test_reach_keeps_the_speed_limit(seed: int) -> None:
    duration_s, positions = reach_positions(seed)
    speeds_m_s = np.linalg.norm(np.diff(positions, axis=0), axis=1) / (duration_s / 499)
    assert speeds_m_s.max() < 1.6
    assert speeds_m_s[[0, -1]].max() < 0.05


def test_arch_lifts_the_middle() -> None:
    _, positions = reach_positions(0, arch_m=0.05)
    assert positions[:, 2].max() > END_M[2] + 0.01


def test_reaches_differ_by_seed_alone() -> None:
    assert np.array_equal(reach_positions(1)[1], reach_positions(1)[1])
    assert not np.array_equal(reach_positions(1)[1], reach_positions(2)[1])


def test_no_distance_is_a_reach_too() -> None:
    _, positions = reach_positions(0, end_m=START_M, arch_m=0.0)
    assert np.abs(positions - START_M).max() < 0.004
