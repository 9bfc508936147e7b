"""A log as a rosbag2 of ROS 2 (MCAP): joint states, transforms, markers, images and log lines."""

from __future__ import annotations

import shutil
from collections import Counter
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Any

from foxglove import messages

from bracket_cell.log.read.frames import CAMERA, IMAGE, LINE, decoded
from bracket_cell.log.read.joints import joint_names
from bracket_cell.log.read.reader import Log
from bracket_cell.packages import needed
from bracket_cell.plant.ros_scene import MARKERS, TF, header, markers, moved, stamp
from bracket_cell.plant.ros_types import message

JOINT_STATE, MOVED = ("/joint_states", "sensor_msgs/msg/JointState"), ("/tf", TF)
STATIC = "/tf_static", TF
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
        InputError: the extra ros2 is not installed.
        OSError: it cannot be written.
    """
    bags, types = (needed(name, "a rosbag2", "ros2") for name in ("rosbags.rosbag2", "rosbags.typesys"))
    known, latched = types.get_typestore(types.Stores.ROS2_HUMBLE), [_latched()]
    channels: dict[tuple[str, str], Any] = {}
    count = 0
    try:
        with bags.Writer(path, version=VERSION, storage_plugin=bags.StoragePlugin.MCAP) as writer:
            for at_ns, of, made in sorted(_all(log), key=lambda sent: sent[0]):
                if of not in channels:
                    qos = latched if of == STATIC else []
                    channels[of] = writer.add_connection(*of, typestore=known, offered_qos_profiles=qos)
                writer.write(channels[of], at_ns, made.serialize())
                count += 1
        (path / f"{path.name}.mcap").rename(path / f"{name}.mcap")
        about = path / "metadata.yaml"
        about.write_text(about.read_text().replace(f"{path.name}.mcap", f"{name}.mcap"))
    except BaseException:
        shutil.rmtree(path, ignore_errors=True)
        raise
    return count


def _all(log: Log) -> Iterator[Sent]:
    start_ns, joints = began_ns(log), list(joint_names(log))
    for tick in log.ticks:
        at_ns, position = start_ns + round(tick.time_s * 1e9), list(tick.observation.arm.positions_rad)
        made = message(JOINT_STATE[1])(header(at_ns), name=joints, position=position, velocity=[], effort=[])
        yield at_ns, JOINT_STATE, made
    told_n = Counter(logged.topic for logged in log.messages)
    for logged in log.messages:
        at_ns, topic = start_ns + logged.time_ns, logged.topic
        if topic.startswith("/tf/"):
            kind: Any = messages.FrameTransform if topic.startswith("/tf/camera_") else messages.FrameTransforms
            data = decoded(log.path, logged, kind)
            frames = [data] if kind is messages.FrameTransform else data.transforms
            once = told_n[topic] <= max(1, len(log.parts)) < len(log.ticks)  # in each part: it stays
            yield at_ns, STATIC if once else MOVED, moved(at_ns, frames)
        elif topic.startswith("/scene/"):
            yield at_ns, (topic, MARKERS), markers(at_ns, decoded(log.path, logged, messages.SceneUpdate))
        elif topic.startswith(CAMERA) and "/" not in topic.removeprefix(CAMERA):
            image = decoded(log.path, logged, IMAGE)
            sent = message(IMAGES)(header(at_ns, image.frame_id), format=image.format, data=image.data)
            yield at_ns, (f"{topic}/compressed", IMAGES), sent
        elif topic == "/log":
            line = decoded(log.path, logged, LINE)
            where = {"file": line.file, "function": "", "line": line.line}
            said = {"level": LEVELS.get(line.level, 40), "name": line.name, "msg": line.message}
            yield at_ns, LOG, message(LOG[1])(stamp(at_ns), **said, **where)


def _latched() -> Any:
    """The quality of service of what is told once, as tf2 offers it."""
    ros = needed("rosbags.interfaces", "a rosbag2", "ros2")
    forever = ros.QosTime(2147483647, 4294967295)
    kept = ros.QosHistory.KEEP_LAST, 1, ros.QosReliability.RELIABLE, ros.QosDurability.TRANSIENT_LOCAL
    return ros.Qos(*kept, forever, forever, ros.QosLiveliness.SYSTEM_DEFAULT, forever, False)


def began_ns(log: Log) -> int:
    """When the run began; times of the log count from there. 0 where the log does not say."""
    try:
        return round(datetime.fromisoformat(log.metadata["started_utc"]).timestamp() * 1e9)
    except (KeyError, ValueError):
        return 0
