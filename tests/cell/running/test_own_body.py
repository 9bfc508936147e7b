"""Where the controller says that the robot was when an overhead frame was taken."""

from dataclasses import replace

import numpy as np
import pytest

from cell.configuration import load_configuration, load_product
from cell.interfaces.clock import ManualClock
from cell.interfaces.devices import Devices
from cell.interfaces.observation import ArmState, GripperState, ObjectStatus
from cell.interfaces.perception import BenchView, Frame, PendingFrame
from cell.interfaces.pose import Pose
from cell.running.device_reader import NEAR_S, DeviceReader, RobotPoseHistory
from cell.running.inference import LockStep
from skills.motion.planner import MotionPlanner
from tests.cell.fakes import FakeArm, FakeCamera, FakeGripper, FakePanel, frame, idle_view, no_parts

CONFIGURATION = load_configuration()
BENCH = CONFIGURATION.bench
LOOK, PARK = (tuple(float(one) for one in joints) for joints in (BENCH.arm_look_rad, BENCH.arm_park_rad))


@pytest.fixture(scope="module")
def motion() -> MotionPlanner:
    return MotionPlanner(load_product(CONFIGURATION), BENCH, CONFIGURATION.motion)


def arm(time_s: float, joints: tuple[float, ...]) -> ArmState:
    return ArmState(time_s, joints, (0.0,) * 6, moving=True)


def fingers(holding: bool) -> GripperState:
    status = ObjectStatus.CONTACT_CLOSING if holding else ObjectStatus.AT_POSITION
    return GripperState(0.0, True, status, 0.02, 0.0, 0)


def test_the_tool_is_in_the_hull_of_the_points_of_its_links(motion: MotionPlanner) -> None:
    body = RobotPoseHistory(motion.separation.outline)
    body.keep(arm(1.0, LOOK), fingers(holding=False))
    points = body.at(1.0)
    assert points is not None
    tool = np.array(motion.kinematics.forward(np.array(LOOK)).position_m)
    assert np.linalg.norm(points - tool, axis=2).min() < 0.05
    body.keep(arm(1.04, LOOK), fingers(holding=True))
    held = body.at(1.04)
    assert held is not None
    assert len(held) == len(points) + 1
    assert (np.abs(held[-1] - tool).max(axis=1) > 0.02).all()
    assert np.allclose(held[-1].mean(axis=0), tool, atol=1e-6)


def test_between_two_ticks_it_is_wherever_the_arm_may_have_been(motion: MotionPlanner) -> None:
    body, nobody = RobotPoseHistory(motion.separation.outline), fingers(holding=False)
    body.keep(arm(1.0, PARK), nobody)
    body.keep(arm(1.04, LOOK), nobody)
    between, after = body.at(1.02), body.at(1.04)
    assert between is not None
    assert after is not None
    assert between.shape[1] == 16
    for joints in (PARK, LOOK):
        tool = np.array(motion.kinematics.forward(np.array(joints)).position_m)
        assert np.linalg.norm(between - tool, axis=2).min() < 0.05
    assert after.shape[1] == 8


def test_it_is_unknown_where_the_arm_was_not_measured_about_then(motion: MotionPlanner) -> None:
    body, nobody = RobotPoseHistory(motion.separation.outline), fingers(holding=False)
    assert body.at(0.0) is None
    body.keep(arm(0.0, (float("nan"), *LOOK[1:])), nobody)
    body.keep(arm(0.0, LOOK[:3]), nobody)
    assert body.at(0.0) is None
    body.keep(arm(0.0, LOOK), nobody)
    assert body.at(0.0) is not None
    assert body.at(NEAR_S + 0.01) is None


def test_detectors_of_the_bench_are_told_and_images_still_come_late(motion: MotionPlanner) -> None:
    clock = ManualClock()
    overhead, wrist = FakeCamera(clock, frame(0)), FakeCamera(clock)
    robot = FakeArm(clock)
    seen: list[Frame] = []

    def watch(taken: Frame) -> BenchView:
        seen.append(taken)
        return idle_view(taken)

    reader = DeviceReader(
        Devices(clock=clock, arm=robot, gripper=FakeGripper(clock), overhead=overhead, wrist=wrist, panel=FakePanel()),
        LockStep(watch, clock, 0.0),
        LockStep(no_parts, clock, 0.0),
        lambda _: None,
        lambda _: None,
        own_body=RobotPoseHistory(motion.separation.outline),
    )
    reader.observe(0)
    assert seen
    assert all(one.robot_m is not None and one.robot_m.shape[2] == 3 for one in seen)

    def no_image() -> np.ndarray:
        raise AssertionError("nobody asked for it")

    pending = PendingFrame("overhead", 0, 0.0, no_image, Pose((0.0, 0.0, 1.0)), lambda: False)
    told = pending.beside(seen[0].robot_m)
    assert told.robot_m is seen[0].robot_m
    assert not told.ready
    assert replace(seen[0], sequence=4).robot_m is seen[0].robot_m
