"""What a stranger's nodes may tell beside what the messages mean."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bracket_cell.plant.ros_arm import Ros2Samples
from bracket_cell.plant.ros_services import Status


@pytest.mark.parametrize("told", [[], [0.1], [math.nan, math.nan], [0.1, math.inf]])
def test_a_column_that_the_hardware_lacks_is_not_told(told: list[float]) -> None:
    assert Ros2Samples._column(told, [1, 0]) is None


def test_a_column_is_in_the_order_of_the_joints() -> None:
    found = Ros2Samples._column([0.1, 0.2, 0.3], [2, 0])
    assert found is not None
    np.testing.assert_array_equal(found, [0.3, 0.1])


def test_a_number_that_no_status_has_is_unknown() -> None:
    assert [Status.of(number) for number in (-1, 2, 7, 99)] == [0, Status.EXECUTING, 0, 0]
