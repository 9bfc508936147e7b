"""The arm's driver for ROS 2 against the twin: the contract of every arm, and what is said where a node is lost."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.plant.ros_arm import Ros2Arm, examine
from bracket_cell.skills.drivers.settings import Ros2ArmSettings
from bracket_ground.contracts.arm import CHECKS, Bench
from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.clock import WallClock
from bracket_sim.twin import controller
from bracket_sim.twin.ros2 import RosArm
from tests.sim.twin.rig import UNLOCK_S, light_cell, slower_now

SETTINGS = Ros2ArmSettings(domain=1 + os.getpid() % 200, middleware="cyclonedds")


@pytest.fixture(scope="module")
def served() -> Iterator[tuple[float, RosArm]]:
    """Pace of a twin, and its arm."""
    slower, controller.UNLOCK_S = slower_now(), UNLOCK_S
    cell = light_cell({"arm": SETTINGS.model_dump()}, "ur10", slower)
    (arm,) = cell.serve()
    assert isinstance(arm, RosArm)
    yield slower, arm
    cell.close()


@pytest.fixture
def bench(served: tuple[float, RosArm]) -> Iterator[Bench]:
    slower, twin = served
    configuration, clock = load_configuration(), WallClock(slower)
    twin.controller.cell.fault("mended")
    with twin.controller.cell.lock:
        twin._run_program()
    arm = Ros2Arm(SETTINGS, clock, load_product(configuration), configuration.robot)
    yield Bench(arm, clock, lambda: twin.controller.cell.fault("protective_stop") and None)
    arm.close()
    arm.close()


@pytest.mark.contract
@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__.removeprefix("check_"))
def test_it_does_what_every_arm_must(bench: Bench, check: Callable[[Bench], None]) -> None:
    check(bench)
