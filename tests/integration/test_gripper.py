"""All grippers of the simulated cell keep the contract: over CAN, at the registers, and a driver in front of these."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest

from bracket_cell.skills.motion.grasp_pose import tool_down
from bracket_cell.skills.motion.trajectory import joint_move
from bracket_ground.contracts import gripper as gripper_contract
from bracket_ground.interfaces.command import GripperCommand
from bracket_ground.interfaces.devices import Gripper
from bracket_ground.interfaces.observation import GripperState
from bracket_sim.devices.simulated_gripper import SimGripper
from tests.integration.robot_alone import RobotAlone

STROKE_M = 0.085

PARTS_BY_WIDTH = {0.028: 0, 0.034: 1, 0.042: 2}
SPOT_M = (0.55, -0.40)


class InFront:
    """A maker's gripper that counts from 0, open, to 1000, closed; its wire is the simulated gripper."""

    def __init__(self, simulated: Gripper) -> None:
        self._wire = simulated

    def state(self) -> GripperState:
        return self._wire.state()

    def activate(self) -> None:
        self._wire.activate()

    def command(self, command: GripperCommand) -> GripperCommand:
        counts = round(1000 * (1 - min(max(command.opening_m, 0.0), STROKE_M) / STROKE_M))
        return self._wire.command(replace(command, opening_m=STROKE_M * (1 - counts / 1000)))

    def hold(self) -> None:
        self._wire.hold()

    def close(self) -> None:
        self._wire.close()


@pytest.fixture
def robot(request: pytest.FixtureRequest) -> Iterator[RobotAlone]:
    """Its fingers reach down to where a part will stand."""
    with RobotAlone(("o1", "o2", "o3"), request.node.nodeid) as robot:
        joints = robot.planner.kinematics.inverse(tool_down((*SPOT_M, 0.045), math.pi / 2))
        assert joints is not None
        robot.arm.follow(joint_move(np.array(robot.bench.arm_park_rad), joints, robot.planner.settings))
        robot.wait(3.0)
        yield robot


GRIPPERS: dict[str, Callable[[RobotAlone], Gripper]] = {
    "can": lambda robot: robot.gripper,
    "simulated": lambda robot: SimGripper(robot.node),
    "in front": lambda robot: InFront(SimGripper(robot.node)),
}


@pytest.mark.long
@pytest.mark.contract
@pytest.mark.parametrize("kind", GRIPPERS)
@pytest.mark.parametrize("check", gripper_contract.CHECKS)
def test_contract(robot: RobotAlone, check: Callable[[gripper_contract.Bench], None], kind: str) -> None:
    def put(width_m: float) -> None:
        robot.stand(robot.parts[PARTS_BY_WIDTH[width_m]], SPOT_M, 0.0)

    check(
        gripper_contract.Bench(GRIPPERS[kind](robot), robot.clock, put, speed_m_s=(0.020, 0.150), force_n=(20.0, 235.0))
    )
