"""A log as a rosbag2 of ROS 2 (MCAP): joint states, transforms, images and log lines, by the `rosbags` package."""

from __future__ import annotations

import shutil
from collections import Counter
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from foxglove import messages

from bracket_cell.log.read.frames import CAMERA, IMAGE, LINE, decoded
from bracket_cell.log.read.joints import joint_names
from bracket_cell.log.read.reader import Log
from bracket_cell.packages import needed

JOINT_STATE, TF = ("/joint_states", "sensor_msgs/msg/JointState"), ("/tf", "tf2_msgs/msg/TFMessage")
STATIC = "/tf_static", TF[1]
IMAGES, LOG = "sensor_msgs/msg/CompressedImage", ("/rosout", "rcl_interfaces/msg/Log")
LEVELS = {0: 10, 1: 10, 2: 20, 3: 30, 4: 40, 5: 50}  # by the numbers of foxglove.Log
VERSION = 9  # of the bag's metadata

Sent = tuple[int, tuple[str, str], Any]


def write_rosbag(log: Log, path: Path, name: str) -> int:
    """Write a folder with a bag; returns how many messages it has.

    Args:
        name: of the bag's file, without its ending.

    Raises:
        LogError: an image, transform or line of the log is damaged.
        InputError: the package is not installed.
        OSError: it cannot be written.
    """
    bags, types = (needed(name, "a rosbag2", "parquet") for name in ("rosbags.rosbag2", "rosbags.typesys"))
    known, latched = types.get_typestore(types.Stores.ROS2_HUMBLE), [_latched()]
    channels: dict[tuple[str, str], Any] = {}
    count = 0
    try:
        with bags.Writer(path, version=VERSION, storage_plugin=bags.StoragePlugin.MCAP) as writer:
            for at_ns, of, message in sorted(_all(log, known.types), key=lambda sent: sent[0]):
                if of not in channels:
                    qos = latched if of == STATIC else []
                    channels[of] = writer.add_connection(*of, typestore=known, offered_qos_profiles=qos)
                writer.write(channels[of], at_ns, known.serialize_cdr(message, of[1]))
                count += 1
        (path / f"{path.name}.mcap").rename(path / f"{name}.mcap")
        about = path / "metadata.yaml"
        about.write_text(about.read_text().replace(f"{path.name}.mcap", f"{name}.mcap"))
    except BaseException:
        shutil.rmtree(path, ignore_errors=True)
        raise
    return count


def _all(log: Log, types: Any) -> Iterator[Sent]:
    start_ns, joints = began_ns(log), list(joint_names(log))

    def header(at_ns: int, frame: str) -> Any:
        return types["std_msgs/msg/Header"](stamp=_stamp(types, at_ns), frame_id=frame)

    for tick in log.ticks:
        at_ns, arm = start_ns + round(tick.time_s * 1e9), tick.observation.arm
        numbers = np.array(arm.positions_rad, np.float64), np.zeros(0), np.zeros(0)
        yield at_ns, JOINT_STATE, types[JOINT_STATE[1]](header(at_ns, ""), joints, *numbers)
    told_n = Counter(message.topic for message in log.messages)
    for message in log.messages:
        at_ns, topic = start_ns + message.time_ns, message.topic
        if topic.startswith("/tf/"):
            kind: Any = messages.FrameTransform if topic.startswith("/tf/camera_") else messages.FrameTransforms
            told = decoded(log.path, message, kind)
            moved = [told] if kind is messages.FrameTransform else told.transforms
            of = (
                STATIC if told_n[topic] <= max(1, len(log.parts)) < len(log.ticks) else TF
            )  # one in each part: it stays
            yield at_ns, of, types[TF[1]]([_transform(types, header(at_ns, one.parent_frame_id), one) for one in moved])
        elif topic.startswith(CAMERA) and "/" not in topic.removeprefix(CAMERA):
            image = decoded(log.path, message, IMAGE)
            data = np.frombuffer(image.data, np.uint8)
            sent = types[IMAGES](header(at_ns, image.frame_id), image.format, data)
            yield at_ns, (f"{topic}/compressed", IMAGES), sent
        elif topic == "/log":
            line = decoded(log.path, message, LINE)
            level = LEVELS.get(line.level, 40)
            sent = types[LOG[1]](_stamp(types, at_ns), level, line.name, line.message, line.file, "", line.line)
            yield at_ns, LOG, sent


def _latched() -> Any:
    """The quality of service of what is told once, as tf2 offers it."""
    ros = needed("rosbags.interfaces", "a rosbag2", "parquet")
    forever = ros.QosTime(2147483647, 4294967295)
    kept = ros.QosHistory.KEEP_LAST, 1, ros.QosReliability.RELIABLE, ros.QosDurability.TRANSIENT_LOCAL
    return ros.Qos(*kept, forever, forever, ros.QosLiveliness.SYSTEM_DEFAULT, forever, False)


def _transform(types: Any, header: Any, told: Any) -> Any:
    at, turn = told.translation, told.rotation
    moved = types["geometry_msgs/msg/Transform"](
        translation=types["geometry_msgs/msg/Vector3"](at.x, at.y, at.z),
        rotation=types["geometry_msgs/msg/Quaternion"](turn.x, turn.y, turn.z, turn.w),
    )
    return types["geometry_msgs/msg/TransformStamped"](header, told.child_frame_id, moved)


def _stamp(types: Any, at_ns: int) -> Any:
    return types["builtin_interfaces/msg/Time"](at_ns // 10**9, at_ns % 10**9)


def began_ns(log: Log) -> int:
    """When the run began; times of the log count from there. 0 where the log does not say."""
    try:
        return round(datetime.fromisoformat(log.metadata["started_utc"]).timestamp() * 1e9)
    except (KeyError, ValueError):
        return 0
