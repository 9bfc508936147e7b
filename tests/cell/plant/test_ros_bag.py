"""`cell doctor --ros2`: what a bag holds, and what of it the cell could take."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from bracket_cell.configuration import load_configuration
from bracket_cell.plant.ros_bag import examined_bag
from bracket_cell.plant.ros_types import DEFINITIONS
from bracket_ground.errors import InputError

LATE_NS, PERIOD_NS, COUNT = 4_000_000, 10_000_000, 50
STORE = get_typestore(Stores.ROS2_HUMBLE)
STORE.register(get_types_from_msg(DEFINITIONS["ur_dashboard_msgs/msg/RobotMode"], "ur_dashboard_msgs/msg/RobotMode"))
STORE.register(get_types_from_msg("int32 number", "own_msgs/msg/Number"))


def header(at_ns: int) -> Any:
    stamp = STORE.types["builtin_interfaces/msg/Time"](at_ns // 10**9, at_ns % 10**9)
    return STORE.types["std_msgs/msg/Header"](stamp, "")


def bag(path: Path, prefix: str = "left_", size: tuple[int, int] = (640, 480), encoding: str = "rgb8") -> Path:
    """A lab's: joints with a prefix, a camera, the arm's mode, and something of its own."""
    robot, types = load_configuration().robot, STORE.types
    names, (width, height) = [f"{prefix}{name}" for name in reversed(robot.joint_names)], size
    pixels = np.zeros(width * height * 3, np.uint8)

    def sent(kind: str, at_ns: int) -> Any:
        if kind == "sensor_msgs/msg/JointState":
            return types[kind](header(at_ns), names, np.zeros(6), np.zeros(6), np.zeros(6))
        if kind == "sensor_msgs/msg/Image":
            return types[kind](header(at_ns), height, width, encoding, 0, width * 3, pixels)
        return types[kind](7)

    topics = {
        "/joint_states": "sensor_msgs/msg/JointState",
        "/camera/color/image_raw": "sensor_msgs/msg/Image",
        "/io_and_status_controller/robot_mode": "ur_dashboard_msgs/msg/RobotMode",
        "/own": "own_msgs/msg/Number",
    }
    with Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        for topic, kind in topics.items():
            connection = writer.add_connection(topic, kind, typestore=STORE)
            for number in range(COUNT if kind.endswith("JointState") else 2):
                at_ns = 10**18 + number * PERIOD_NS
                writer.write(connection, at_ns + LATE_NS, STORE.serialize_cdr(sent(kind, at_ns), kind))
    return path


def found(path: Path) -> dict[str, tuple[str, str]]:
    configuration = load_configuration()
    checks = examined_bag(path, configuration.robot, configuration.bench)
    return {check.what.split(" ")[0]: (check.what, check.remedy) for check in checks}


def test_topics_rates_delays_and_what_takes_them(tmp_path: Path) -> None:
    setup = load_configuration().bench.overhead
    told = found(bag(tmp_path / "bag", size=(setup.width_px, setup.height_px)))
    joints, remedy = told["/joint_states"]
    assert "50 messages, 100.0 a second, 4.0 ms after their stamps (95 %: 4.0 ms)" in joints
    assert "arm: all joints of ur10, prefix: left_" in joints
    assert remedy == ""
    assert "overhead" in told["/camera/color/image_raw"][0]
    assert told["/camera/color/image_raw"][1] == ""
    assert "power and brakes" in told["/io_and_status_controller/robot_mode"][0]
    assert told["/own"][1] == "nothing of the cell takes this type"


def test_why_a_topic_cannot_be_taken(tmp_path: Path) -> None:
    image = found(bag(tmp_path / "a", size=(64, 48)))["/camera/color/image_raw"]
    assert "the bench file says overhead" in image[1]
    setup = load_configuration().bench.overhead
    image = found(bag(tmp_path / "b", size=(setup.width_px, setup.height_px), encoding="yuv422"))[
        "/camera/color/image_raw"
    ]
    assert "its encoding is yuv422, must be rgb8" in image[1]


def test_what_is_no_bag_is_said_in_words(tmp_path: Path) -> None:
    (tmp_path / "junk").write_text("junk")
    for path in (tmp_path / "junk", tmp_path / "nothing"):
        with pytest.raises(InputError, match="no bag of ROS 2 that can be read"):
            found(path)
