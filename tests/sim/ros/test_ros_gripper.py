"""The gripper's driver for ROS 2 against the twin: the contract, and what is said of a node that is silent."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator

import pytest

from bracket_cell.configuration import load_configuration
from bracket_cell.plant.ros_gripper import Ros2Gripper, examine
from bracket_cell.skills.drivers.settings import Ros2GripperSettings
from bracket_ground.contracts.gripper import CHECKS, Bench
from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.clock import WallClock
from bracket_ground.interfaces.command import GripperCommand
from bracket_sim.twin.ros2 import RosGripper
from tests.sim.twin.rig import light_cell, slower_now
from tests.skills.ideal_fingers import IdealFingers

SETTINGS = Ros2GripperSettings(domain=1 + (os.getpid() + 57) % 200, middleware="cyclonedds", lost_s=1.0)


@pytest.fixture(scope="module")
def served() -> Iterator[tuple[float, RosGripper]]:
    """Pace of a twin, and its gripper."""
    slower = slower_now()
    cell = light_cell({"gripper": SETTINGS.model_dump()}, "ur10", slower)
    (gripper,) = cell.serve()
    assert isinstance(gripper, RosGripper)
    yield slower, gripper
    cell.close()


@pytest.fixture
def bench(served: tuple[float, RosGripper]) -> Iterator[Bench]:
    slower, twin = served
    clock = WallClock(slower)
    fingers = IdealFingers(clock)
    twin._node = fingers  # type: ignore[assignment]
    twin._registers |= {"rACT": 0.0, "rGTO": 0.0}

    def put(width_m: float) -> None:
        fingers.part_m = width_m

    gripper = Ros2Gripper(SETTINGS, clock, load_configuration().robot)
    yield Bench(gripper, clock, put)
    gripper.close()
    gripper.close()


@pytest.mark.contract
@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__.removeprefix("check_"))
def test_it_does_what_every_gripper_must(bench: Bench, check: Callable[[Bench], None]) -> None:
    check(bench)


def test_a_gripper_that_is_silent_or_refuses_is_a_fault_in_words(
    bench: Bench, served: tuple[float, RosGripper]
) -> None:
    bench.wait(0.4)
    bench.gripper.command(GripperCommand(0.02))
    with pytest.raises(DeviceFault, match="gripper_cmd refuses goal"):
        bench.wait(3.0)
    bench.activated()
    served[1]._silence()
    with pytest.raises(DeviceFault, match="robotiq_85_left_knuckle_joint was not told for"):
        bench.wait(3.0)
    served[1]._silence()
    bench.clock.sleep_until(bench.clock.now_s() + 0.5)
    assert bench.gripper.state().activated


def test_a_look_moves_nothing_and_says_what_is_missing(served: tuple[float, RosGripper]) -> None:
    clock, robot = WallClock(served[0]), load_configuration().robot
    (found,) = examine(SETTINGS, clock, robot)
    assert not found.remedy
    (missing,) = examine(SETTINGS.model_copy(update={"action": "/other/gripper_cmd"}), clock, robot)
    assert "no node has the action /other/gripper_cmd" in missing.remedy
