"""Where on its path a UR is."""

from __future__ import annotations

import numpy as np
import pytest

from skills.drivers.rtde_receiver import Sample
from skills.drivers.ur import nearest_s
from skills.motion.settings import MotionSettings
from skills.motion.trajectory import joint_move

PATH = joint_move(np.zeros(6), np.full(6, 0.4), MotionSettings())


def told_s(about_s: float, trails_s: float, off_rad: float) -> float:
    """The place that is told where the joints trail by a time and are off by an angle."""
    (joints,) = PATH.along(np.array([about_s - trails_s]))
    still = np.zeros(6)
    return nearest_s(PATH, about_s, Sample(0.0, joints + off_rad, still, still, 7, 1, 2, 1.0))


def test_in_the_middle_of_a_path_the_joints_tell_the_place() -> None:
    middle_s = PATH.duration_s / 2
    assert told_s(middle_s, 0.01, 0.0) == pytest.approx(middle_s - 0.01, abs=1e-3)


@pytest.mark.parametrize("off_rad", [-0.001, 0.001])
def test_where_the_arm_hardly_moves_time_tells_it(off_rad: float) -> None:
    near_end_s = PATH.duration_s - 0.02
    assert told_s(near_end_s, 0.0, off_rad) == pytest.approx(near_end_s, abs=5e-3)
