"""Where the controller says that the robot was when an overhead frame was taken."""

from dataclasses import replace

import numpy as np
import pytest

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.running.device_reader import NEAR_S, DeviceReader, RobotPoseHistory
from bracket_cell.running.inference import LockStep
from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_ground.interfaces.clock import ManualClock
from bracket_ground.interfaces.devices import Devices
from bracket_ground.interfaces.frame import Frame, PendingFrame
from bracket_ground.interfaces.observation import ArmState, GripperState, JointSamples, ObjectStatus
from bracket_ground.interfaces.perception import BenchView
from bracket_ground.interfaces.pose import Array, Pose
from tests.cell.fakes import FakeArm, FakeCamera, FakeGripper, FakePanel, frame, idle_view, no_parts

CONFIGURATION = load_configuration()
BENCH = CONFIGURATION.bench
LOOK, PARK = (tuple(float(joint) for joint in joints) for joints in (BENCH.arm_look_rad, BENCH.arm_park_rad))


@pytest.fixture(scope="module")
def motion() -> MotionPlanner:
    return MotionPlanner(load_product(CONFIGURATION), BENCH, CONFIGURATION.motion)


def arm(time_s: float, joints: tuple[float, ...]) -> ArmState:
    return ArmState(time_s, joints, (0.0,) * 6, moving=True)


def fingers(holding: bool) -> GripperState:
    status = ObjectStatus.CONTACT_CLOSING if holding else ObjectStatus.AT_POSITION
    return GripperState(0.0, True, status, 0.02, 0.0, 0)


def test_the_tool_is_in_the_hull_of_the_points_of_its_links(motion: MotionPlanner) -> None:
    body = RobotPoseHistory(motion.separation.outline, motion.kinematics.forward)
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
    body, nobody = RobotPoseHistory(motion.separation.outline, motion.kinematics.forward), fingers(holding=False)
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
    body, nobody = RobotPoseHistory(motion.separation.outline, motion.kinematics.forward), fingers(holding=False)
    assert body.at(0.0) is None
    body.keep(arm(0.0, (float("nan"), *LOOK[1:])), nobody)
    body.keep(arm(0.0, LOOK[:3]), nobody)
    assert body.at(0.0) is None
    body.keep(arm(0.0, LOOK), nobody)
    assert body.at(0.0) is not None
    assert body.at(NEAR_S + 0.01) is None


def test_the_tool_at_an_exposure_is_between_what_was_measured(motion: MotionPlanner) -> None:
    body, nobody = RobotPoseHistory(motion.separation.outline, motion.kinematics.forward), fingers(holding=False)
    assert body.tool_at(1.0) is None
    park, look = np.array(PARK), np.array(LOOK)

    def joints(time_s: float) -> Array:
        """Slowing down, so that no straight line fits."""
        place: Array = park + (1 - (1 - time_s) ** 2) * (look - park)
        return place

    times_s = np.array([0.008 * number for number in range(60)])
    positions: Array = np.array([joints(float(one)) for one in times_s])
    body.sampled(JointSamples(times_s, positions, 0 * positions, 0 * positions))
    body.keep(arm(0.5, tuple(joints(0.5).tolist())), nobody)
    for time_s in (0.0, 0.1234, 0.49):
        told, wanted = body.tool_at(time_s), motion.kinematics.forward(joints(time_s))
        assert told is not None
        assert np.allclose(told.position_m, wanted.position_m, atol=1e-3)
    assert body.tool_at(0.5 + NEAR_S + 0.01) is None
    assert body.tool_at(-NEAR_S - 0.01) is None


def test_a_wrist_frame_gets_the_arms_place_or_is_not_used(motion: MotionPlanner) -> None:
    clock, mount, placed = ManualClock(), Pose((0.0, -0.09, -0.12)), list[Frame]()
    wrist = FakeCamera(clock, replace(frame(0), camera="wrist", world_from_camera=mount, at_tool=True))
    robot = FakeArm(clock)
    reader = DeviceReader(
        Devices(clock=clock, arm=robot, gripper=FakeGripper(clock), overhead=FakeCamera(clock), wrist=wrist,
                panel=FakePanel()),
        LockStep(idle_view, clock, 0.0),
        LockStep(no_parts, clock, 0.0),
        placed.append,
        lambda _: None,
        own_body=RobotPoseHistory(motion.separation.outline, motion.kinematics.forward),
    )  # fmt: skip
    reader.observe(0)
    tool = motion.kinematics.forward(np.array(robot.state().positions_rad))
    assert np.allclose(placed[-1].world_from_camera.position_m, (tool @ mount).position_m)
    assert not placed[-1].at_tool
    wrist.newest = replace(frame(1), camera="wrist", time_s=1.0, world_from_camera=mount, at_tool=True)
    clock.sleep_until(clock.now_s() + 0.04)
    seen = reader.observe(1)
    assert [trouble.reason for trouble in seen.troubles] == [
        "camera wrist: the arm was not measured when its frame was taken"
    ]


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
        own_body=RobotPoseHistory(motion.separation.outline, motion.kinematics.forward),
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
