"""A camera of the twin by ROS 2: colours and depths of one stamp are one frame."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np
import pytest

from bracket_cell.configuration import load_configuration
from bracket_cell.plant.dds import Node
from bracket_cell.plant.ros_camera import Ros2Camera, _mount
from bracket_cell.plant.ros_frames import Frames
from bracket_cell.skills.drivers.settings import Ros2CameraSettings
from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.clock import WallClock
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.pose import Pose
from bracket_sim.twin.ros2 import RosCamera
from tests.sim.twin.rig import light_cell

SETTINGS = Ros2CameraSettings(
    domain=1 + (os.getpid() + 83) % 200,
    topic="/overhead/color/image_raw",
    depth="/overhead/aligned_depth_to_color/image_raw",
    lost_s=1.0,
)
BENCH = load_configuration().bench
DEEP = BENCH.model_copy(update={"overhead": BENCH.overhead.model_copy(update={"depth": True})})


def until(holds: Callable[[], Any]) -> Any:
    end_s = time.monotonic() + 30.0
    while not (found := holds()):
        assert time.monotonic() < end_s, "it did not come"
        time.sleep(0.02)
    return found


def newest(camera: Ros2Camera) -> Frame | None:
    with suppress(DeviceFault):
        return camera.latest()
    return None


def trouble(camera: Ros2Camera) -> str:
    try:
        camera.latest()
    except DeviceFault as fault:
        return str(fault)
    return ""


def test_colours_and_depths_of_one_stamp_come_and_a_lost_depth_is_no_fault_of_its_own() -> None:
    cell = light_cell({"overhead": SETTINGS.model_dump()}, "ur10", 1.0)
    (served,) = cell.serve()
    assert isinstance(served, RosCamera)
    served.close()  # what the twin sees itself; the test sends its own
    overhead = Ros2Camera(SETTINGS, WallClock(), DEEP, "overhead")
    rng = np.random.default_rng(5)
    size = BENCH.overhead.height_px, BENCH.overhead.width_px
    image, depth_mm = rng.integers(0, 255, (*size, 3), np.uint8), rng.integers(0, 3000, size, np.uint16)

    def taken(with_depth: bool = True) -> None:
        depth = depth_mm if with_depth else None
        served._send(Frame("overhead", 0, cell.now_s(), image, Pose((0.0, 0.0, 1.0)), depth_mm=depth))

    def came() -> Frame | None:
        taken()
        return newest(overhead)

    try:
        frame = until(came)
        np.testing.assert_array_equal(frame.image, image)
        np.testing.assert_array_equal(frame.depth_mm, depth_mm)
        for _ in range(5):
            taken(with_depth=False)
            assert not trouble(overhead)
            time.sleep(0.05)

        def said() -> str:
            taken(with_depth=False)
            return trouble(overhead)

        until(lambda: "nothing comes on /overhead/color/image_raw with depths" in said())
        until(came)
    finally:
        overhead.close()
        cell.close()


@pytest.mark.parametrize(("role", "frame"), [("overhead", "base_link"), ("wrist", "tool0")])
def test_the_twin_tells_by_tf_where_a_camera_hangs(role: str, frame: str) -> None:
    settings = SETTINGS.model_copy(update={"topic": f"/{role}/color/image_raw", "depth": "", "frame": frame})
    cell, robot = light_cell({role: settings.model_dump()}, "ur10", 1.0), load_configuration().robot
    try:
        cell.serve()
        found = Frames(Node(settings)).pose(frame, f"{role}_optical_frame", 10.0)
        assert _mount(found, "its frame", BENCH, role, settings, robot).remedy == ""
    finally:
        cell.close()
