"""The CAN driver and the simulated gripper node keep the same contract as driver and scripted node."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from skills.motion.grasp_pose import tool_down
from skills.motion.trajectory import joint_move
from tests.integration.robot_alone import RobotAlone
from tests.skills import gripper_contract

PARTS_BY_WIDTH = {0.028: 0, 0.034: 1, 0.042: 2}
SPOT_M = (0.55, -0.40)


@pytest.fixture
def robot(request: pytest.FixtureRequest) -> Iterator[RobotAlone]:
    """Its fingers reach down to where a part will stand."""
    with RobotAlone(("o1", "o2", "o3"), request.node.nodeid) as robot:
        joints = robot.planner.kinematics.inverse(tool_down((*SPOT_M, 0.045), math.pi / 2))
        assert joints is not None
        robot.arm.follow(joint_move(np.array(robot.bench.arm_park_rad), joints, robot.planner.settings))
        robot.wait(3.0)
        yield robot


@pytest.mark.parametrize("check", gripper_contract.CHECKS)
def test_contract(robot: RobotAlone, check: Callable[[gripper_contract.Bench], None]) -> None:
    def put(width_m: float) -> None:
        robot.stand(robot.parts[PARTS_BY_WIDTH[width_m]], SPOT_M, 0.0)

    check(gripper_contract.Bench(robot.gripper, robot.clock, put))
