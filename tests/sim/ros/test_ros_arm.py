"""The arm's driver for ROS 2 against the twin: the contract of every arm, and what is said where a node is lost."""

from __future__ import annotations

import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.plant.dds import SENSOR, Node
from bracket_cell.plant.ros_arm import JOINTS, Ros2Arm, Ros2Link, examine
from bracket_cell.plant.ros_types import empty
from bracket_cell.skills.drivers.settings import Ros2ArmSettings
from bracket_ground.contracts.arm import CHECKS, OFF_PATH_RAD, Bench, off_rad
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

    def stop() -> None:
        twin.controller.cell.fault("protective_stop")

    yield Bench(arm, clock, stop)
    arm.close()
    arm.close()


@pytest.mark.contract
@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__.removeprefix("check_"))
def test_it_does_what_every_arm_must(bench: Bench, check: Callable[[Bench], None]) -> None:
    check(bench)


def test_a_driver_that_is_started_again_is_a_stop_that_is_acknowledged(
    bench: Bench, served: tuple[float, RosArm]
) -> None:
    bench.half_way()
    served[1].controller.cell.fault("joints_cut")
    stopped = bench.until(lambda state: state.mode != "normal")[-1]
    assert (stopped.mode, bool(stopped.reason)) == ("not_controlled", True)
    bench.stand()
    bench.until(lambda state: bench.clock.now_s() - state.time_s < 0.1, 20.0)
    bench.arm.acknowledge()
    bench.until(lambda state: state.mode == "normal", 20.0)
    bench.arm.follow(bench.way(0.3))
    bench.rest()


def test_silent_joints_are_an_old_state_with_a_reason_and_the_arm_stands_on_its_path(
    bench: Bench, served: tuple[float, RosArm]
) -> None:
    path = bench.half_way()
    served[1].controller.cell.fault("joints_silent")
    bench.share = 0.0  # a supervisor holds an arm that is not seen
    old = bench.until(lambda state: bool(state.reason))[-1]
    assert "joint_states" in old.reason or "no sample" in old.reason
    assert old.mode == "normal"
    bench.until(lambda state: bench.clock.now_s() - state.time_s < 0.1, 20.0)
    bench.share = 1.0
    bench.rest()
    assert bench.until(lambda state: not state.reason)[-1].mode == "normal"  # one late sample is a reason for a moment
    assert np.abs(bench.at_rad - path.at(path.duration_s)).max() < 0.006


def test_goals_end_at_rest_on_the_path_where_no_more_come(bench: Bench) -> None:
    path = bench.half_way()
    stream = bench.arm._stream  # type: ignore[attr-defined]
    os.kill(stream.child.process_id, signal.SIGSTOP)
    stopped = bench.until(lambda state: state.mode != "normal")[-1]
    assert "set point" in stopped.reason
    bench.stand()
    assert off_rad(path, bench.at_rad) < OFF_PATH_RAD


def test_the_slider_is_obeyed_by_the_scaled_controller_alone(bench: Bench, served: tuple[float, RosArm]) -> None:
    served[1].controller.cell.fault("slider")
    path = bench.half_way()
    seen = [np.abs(state.velocities_rad_s).max() for state in bench.until(lambda state: not state.moving, 20.0)]
    fastest = np.percentile(seen, 95)  # a late sample on a busy machine tells one wrong speed
    served[1].controller.cell.fault("slider_full")
    assert np.abs(bench.at_rad - path.at(path.duration_s)).max() < 0.006
    full = np.abs(np.diff(path.positions_rad, axis=0)).max() / np.diff(path.times_s).max()
    assert 0.2 < fastest / full < 0.4


def test_a_goal_that_begins_later_is_gone_to_meanwhile(served: tuple[float, RosArm]) -> None:
    """As scaled_joint_trajectory_controller does: no jump to its first point."""
    twin, speed_rad_s, later_s = served[1], 0.3, 0.16
    with twin.controller.cell.lock:
        twin.controller.cell.fault("mended")
        twin._run_program()
        began_s, began_rad = twin._cell.now_s(), twin._arm.measured.positions_rad.copy()

        def goal(first_s: float) -> object:
            made = empty("control_msgs/action/FollowJointTrajectory_Goal")
            made.trajectory.header = twin._clock.header(began_s + first_s)
            made.trajectory.joint_names = twin._names
            for time_s in (0.0, 0.2, 0.4):
                point = empty("trajectory_msgs/msg/JointTrajectoryPoint")
                point.positions = (began_rad + speed_rad_s * (first_s + time_s)).tolist()
                point.time_from_start.nanosec = round(1e9 * time_s)
                made.trajectory.points.append(point)
            return made

        assert twin._accept(goal(0.0))
        asked = []
        for _ in range(3):
            twin._follow()
            asked.append(twin.asked_rad[0])
        assert twin._accept(goal(later_s))
        for _ in range(3):
            twin._follow()
            asked.append(twin.asked_rad[0])
        twin._cancel()
    assert np.diff(asked).max() < 1.2 * speed_rad_s * twin._cell.period_s


def test_what_is_missing_is_said_in_words() -> None:
    configuration = load_configuration()
    nobody = SETTINGS.model_copy(update={"namespace": "/nobody"})
    with pytest.raises(
        DeviceFault, match="no controller answers at /nobody/joint_states: ur_robot_driver does not tell"
    ):
        Ros2Arm(nobody, WallClock(), load_product(configuration), configuration.robot)


def test_a_look_says_rate_mode_and_controller(served: tuple[float, RosArm]) -> None:
    twin, robot = served[1], load_configuration().robot
    twin.controller.cell.fault("mended")
    with twin.controller.cell.lock:
        twin._run_program()
    found = list(examine(SETTINGS, robot, WallClock(served[0])))
    assert [check.remedy for check in found] == ["", "", ""]
    other = SETTINGS.model_copy(update={"controller": "joint_trajectory_controller"})
    assert "no node has it" in list(examine(other, robot, WallClock(served[0])))[-1].remedy


def test_the_controllers_time_is_told_by_the_arms_own_joints_alone() -> None:
    """Others tell theirs on the same topic, and may be heard first."""
    node, link = Node(SETTINGS), Ros2Link.__new__(Ros2Link)
    link._joints, link._names, link._slower, link._ur = node.subscription("/both", JOINTS, SENSOR), ["a"], 1.0, None
    link._offsets_s = deque()
    writer = node.publisher("/both", JOINTS)

    def told(name: str) -> None:
        said = empty(JOINTS)
        said.name = [name]
        writer.write(said)

    later = threading.Timer(0.3, told, ["a"])
    told("finger")
    later.start()
    link._clock(10.0)
    assert len(link._offsets_s) == 1
    later.join()
