"""What a bag that ROS 2 recorded holds, and which of its topics the cell's devices could take."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bracket_cell.packages import needed
from bracket_cell.plant.ros_camera import TO_RGB
from bracket_cell.plant.ros_types import DEFINITIONS
from bracket_ground.errors import InputError, counted, words_of
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.devices import DeviceCheck
from bracket_ground.interfaces.robot import RobotModel

LOOKED_N = 2000  # messages of a topic that are decoded
UNKNOWN = "nothing of the cell takes this type"
USED: Mapping[str, str] = {
    "ur_msgs/msg/IOStates": "signals: its digital terminals",
    "ur_dashboard_msgs/msg/SafetyMode": "arm: whether it may move",
    "ur_dashboard_msgs/msg/RobotMode": "arm: power and brakes",
    "tf2_msgs/msg/TFMessage": "",
}  # types whose messages need no look


@dataclass
class Topic:
    """A topic of the bag.

    Attributes:
        delays_s: from the stamps in messages to when they were recorded.
        first: a message; None where the type is not known.
    """

    name: str
    kind: str
    count: int
    times_s: list[float] = field(default_factory=list)
    delays_s: list[float] = field(default_factory=list)
    first: Any = None

    @property
    def told(self) -> str:
        """Rate and delays in words."""
        spent_s = self.times_s[-1] - self.times_s[0] if len(self.times_s) > 1 else 0.0
        text = f"{self.name} ({self.kind}): {counted(self.count, 'message')}"
        text += f", {(len(self.times_s) - 1) / spent_s:.1f} a second" if spent_s > 0 else ""
        if self.delays_s:
            middle, late = (1e3 * np.quantile(self.delays_s, share) for share in (0.5, 0.95))
            text += f", {middle:.1f} ms after their stamps (95 %: {late:.1f} ms)"
        return text


def examined_bag(path: Path, robot: RobotModel, bench: Bench) -> Iterator[DeviceCheck]:
    """Each topic with its rate and delays, and why the cell could not take it.

    Raises:
        InputError: it is no bag that can be read, or the extra is missing.
    """
    topics = _read(path)
    for topic in sorted(topics, key=lambda known: known.name):
        used = _used(topic, robot, bench)
        yield DeviceCheck(f"{topic.told}{f': {used[0]}' if used[0] else ''}", used[1])
    if not any(topic.kind == "sensor_msgs/msg/JointState" for topic in topics):
        yield DeviceCheck("arm: joint states", "there are none")


def _read(path: Path) -> list[Topic]:
    bags, types = (needed(f"rosbags.{name}", "a bag", "ros2") for name in ("highlevel", "typesys"))
    store = types.get_typestore(types.Stores.ROS2_HUMBLE)
    for name, text in DEFINITIONS.items():
        if "/msg/" in name:
            store.register(types.get_types_from_msg(text, name))
    try:
        with bags.AnyReader([path], default_typestore=store) as reader:
            topics = {(of.topic, of.msgtype): Topic(of.topic, of.msgtype, of.msgcount) for of in reader.connections}
            for of, time_ns, data in reader.messages():
                decoded = partial(reader.deserialize, data, of.msgtype)
                _note(topics[of.topic, of.msgtype], time_ns * 1e-9, decoded)
            return list(topics.values())
    except (bags.AnyReaderError, OSError, ValueError) as error:
        raise InputError(f"{path}: no bag of ROS 2 that can be read: {words_of(error)}") from None


def _note(topic: Topic, time_s: float, decoded: Callable[[], Any]) -> None:
    topic.times_s.append(time_s)
    if len(topic.times_s) > LOOKED_N:
        return
    try:
        message = decoded()
    except (KeyError, ValueError, AssertionError, IndexError):  # its type is not known, or it is damaged
        return
    topic.first = topic.first or message
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    if stamp is not None and stamp.sec:
        topic.delays_s.append(time_s - stamp.sec - stamp.nanosec * 1e-9)


def _used(topic: Topic, robot: RobotModel, bench: Bench) -> tuple[str, str]:
    """What takes the topic, and why it cannot."""
    first = topic.first
    if topic.kind in USED:
        return USED[topic.kind], ""
    if first is None:
        return "", "empty" if not topic.count else UNKNOWN
    match topic.kind.rsplit("/")[-1]:
        case "JointState":
            return _joints(list(first.name), robot)
        case "Image":
            legal = (*TO_RGB, "16UC1")
            wrong = "" if first.encoding in legal else f"its encoding is {first.encoding}, must be {', '.join(legal)}"
            return _sized(first, bench, wrong)
        case "CompressedImage":
            return f"camera: {first.format}", ""
        case "CameraInfo":
            return _sized(first, bench, "")
    return "", UNKNOWN


def _joints(names: list[str], robot: RobotModel) -> tuple[str, str]:
    ends = [next((name for name in names if name.endswith(joint)), None) for joint in robot.joint_names]
    if None in ends:
        text = f"joints {', '.join(names[:8])}; {robot.name} has {', '.join(robot.joint_names)}"
        return "joints of something else", text
    prefix = str(ends[0]).removesuffix(robot.joint_names[0])
    return f"arm: all joints of {robot.name}{f', prefix: {prefix}' if prefix else ''}", ""


def _sized(first: Any, bench: Bench, wrong: str) -> tuple[str, str]:
    size = first.width, first.height
    fits = [role for role in ("overhead", "wrist") if size == _size(bench, role)]
    sizes = ", ".join(f"{role} {w} x {h}" for role in ("overhead", "wrist") for w, h in (_size(bench, role),))
    text = f"camera: {size[0]} x {size[1]} pixels"
    return (f"{text}, as {' and '.join(fits)}", wrong) if fits else (text, wrong or f"the bench file says {sizes}")


def _size(bench: Bench, role: str) -> tuple[int, int]:
    setup = getattr(bench, role)
    return setup.width_px, setup.height_px
