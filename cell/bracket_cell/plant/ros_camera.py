"""A camera that a node of ROS 2 publishes: sensor_msgs/Image or CompressedImage, a depth image, and CameraInfo."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from bracket_cell.plant.dds import SENSOR, Node, taken, waited
from bracket_cell.plant.ros_frames import Frames
from bracket_cell.skills.drivers import cameras
from bracket_cell.skills.drivers.cameras import GrabbingCamera, Image
from bracket_cell.skills.drivers.settings import Ros2CameraSettings
from bracket_ground.interfaces.bench import Bench, CameraSetup
from bracket_ground.interfaces.clock import Clock
from bracket_ground.interfaces.devices import DeviceCheck
from bracket_ground.interfaces.frame import together
from bracket_ground.interfaces.intrinsics import BROWN
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.robot import RobotModel

FRAME_S = 1.0  # in which a frame must come
OLDEST_S = 10.0  # a stamp that is farther from the wall clock is of another clock, as of a simulation
DEPTH_S, DEPTHS_N = 0.1, 8  # that a depth image may come after its image; of those that are kept
INFO_S = 3.0  # to wait for CameraInfo
MOUNT_OFF_M, MOUNT_OFF_RAD = 0.005, 0.01  # that tf and bench file may differ by
RECTIFIED = "image_rect"  # in topics of image_proc
COMPRESSED = "/compressed"
# By encoding: sensor_msgs/image_encodings.hpp.
TO_RGB = {"rgb8": None, "bgr8": cv2.COLOR_BGR2RGB, "rgba8": cv2.COLOR_RGBA2RGB, "bgra8": cv2.COLOR_BGRA2RGB}


class _Subscribed:
    """Implements `Source`."""

    def __init__(self, settings: Ros2CameraSettings, slower: float) -> None:
        kind = "CompressedImage" if settings.topic.endswith(COMPRESSED) else "Image"
        self._topic, self._slower = settings.topic, slower
        node = Node(settings)
        self._reader: Any = node.subscription(settings.topic, f"sensor_msgs/msg/{kind}", SENSOR)
        self._depths: Any = None
        if settings.depth:
            self._depths = node.subscription(settings.depth, "sensor_msgs/msg/Image", SENSOR)
        self._kept: deque[Any] = deque(maxlen=DEPTHS_N)

    def grab(self) -> tuple[Image, float | None]:
        """As in `Source`."""
        until_s = time.monotonic() + FRAME_S * self._slower
        while (left_s := until_s - time.monotonic()) > 0 and (came := waited(self._reader, left_s)) is not None:
            depth_mm = self._depth(came.header.stamp)
            if self._depths is not None and depth_mm is None:
                continue  # depths are lost like any other sample of a sensor
            image = _decoded(came) if self._topic.endswith(COMPRESSED) else _image(came)
            ago_s = time.time() - came.header.stamp.sec - came.header.stamp.nanosec * 1e-9
            image = image if depth_mm is None else together(image, depth_mm)
            return image, ago_s if 0 <= ago_s <= OLDEST_S and self._slower == 1.0 else None
        raise OSError(f"nothing comes on {self._topic}" + (" with depths of its stamps" if self._depths else ""))

    def close(self) -> None:
        """As in `Source`."""
        self._reader = self._depths = None

    def _depth(self, stamp: Any) -> NDArray[np.uint16] | None:
        until_s = time.monotonic() + DEPTH_S * self._slower
        while self._depths is not None:
            self._kept.extend(taken(self._depths))
            if (found := next((message for message in self._kept if message.header.stamp == stamp), None)) is not None:
                return _millimetres(found)
            if time.monotonic() > until_s:
                return None
            if (came := waited(self._depths, 0.01)) is not None:
                self._kept.append(came)
        return None


class Ros2Camera(GrabbingCamera):
    """A camera of ROS 2."""

    Settings = Ros2CameraSettings

    def __init__(self, settings: Ros2CameraSettings, clock: Clock, bench: Bench, role: str) -> None:
        super().__init__(settings, clock, bench, role, lambda _: _Subscribed(settings, getattr(clock, "slower", 1.0)))


def _image(came: Any) -> Image:
    """A sensor_msgs/Image in RGB."""
    if came.encoding not in TO_RGB:
        raise OSError(f"images are {came.encoding[:20]!r}, must be {', '.join(TO_RGB)}")
    data, channels = np.frombuffer(bytes(came.data), np.uint8), len(came.encoding) - 1
    if came.step < came.width * channels or data.size != came.height * came.step or not data.size:
        raise OSError(f"an image of {came.width} x {came.height} pixels has {data.size} bytes")
    rows = data.reshape(came.height, came.step)[:, : came.width * channels]
    image = np.ascontiguousarray(rows).reshape(came.height, came.width, channels)
    code = TO_RGB[came.encoding]
    return image if code is None else np.asarray(cv2.cvtColor(image, code), np.uint8)


def _decoded(came: Any) -> Image:
    """A sensor_msgs/CompressedImage in RGB."""
    with suppress(cv2.error):  # it is empty, or says that it is enormous
        if (image := cv2.imdecode(np.frombuffer(bytes(came.data), np.uint8), cv2.IMREAD_COLOR_RGB)) is not None:
            return np.asarray(image, np.uint8)
    raise OSError("a compressed image cannot be decoded")


def _millimetres(came: Any) -> NDArray[np.uint16]:
    """A depth image, as realsense-ros has it."""
    if came.encoding != "16UC1":
        raise OSError(f"depth images are {came.encoding[:20]!r}, must be 16UC1")
    data = np.frombuffer(bytes(came.data), ">u2" if came.is_bigendian else "<u2")
    if data.size != came.width * came.height or not data.size:
        raise OSError(f"a depth image of {came.width} x {came.height} pixels has {2 * data.size} bytes")
    return data.reshape(came.height, came.width).astype(np.uint16)


def examine(
    settings: Ros2CameraSettings, clock: Clock, bench: Bench, role: str, robot: RobotModel
) -> Iterator[DeviceCheck]:
    """As of every camera, its lens by CameraInfo, and its mount by tf."""
    yield from cameras.examine(settings, clock, bench, role)
    if settings.info:
        reader = Node(settings).subscription(settings.info, "sensor_msgs/msg/CameraInfo", SENSOR)
        yield _lens(info := waited(reader, INFO_S), bench, role, settings)
        if info is not None and settings.frame:
            found = Frames(Node(settings)).pose(settings.frame, info.header.frame_id, INFO_S)
            yield _mount(found, info.header.frame_id, bench, role, settings, robot)


def _mount(
    found: Pose | None, camera: str, bench: Bench, role: str, settings: Ros2CameraSettings, robot: RobotModel
) -> DeviceCheck:
    """Whether the bench file has the mount that tf tells."""
    text = f"camera {role}: its mount by tf, from {settings.frame} to {camera}"
    if found is None:
        return DeviceCheck(text, "/tf and /tf_static do not tell it")
    tool = Pose((0.0, 0.0, robot.gripper.tcp_from_flange_m if role == "wrist" else 0.0))  # where the mount begins
    found, mount = tool.inverse() @ found, getattr(bench, role).mount.pose
    off = mount.inverse() @ found
    off_m, off_rad = float(np.linalg.norm(off.position_m)), 2 * np.arccos(min(1.0, abs(off.quaternion_wxyz[0])))
    if off_m <= MOUNT_OFF_M and off_rad <= MOUNT_OFF_RAD:
        return DeviceCheck(text)
    at, turned = ([round(value, 4) for value in values] for values in (found.position_m, found.quaternion_wxyz))
    apart = f"{1e3 * off_m:.0f} mm and {np.degrees(off_rad):.1f} degrees from the bench file's"
    return DeviceCheck(text, f"{apart}; by tf mount: {{position_m: {at}, quaternion_wxyz: {turned}}}")


def _lens(info: Any, bench: Bench, role: str, settings: Ros2CameraSettings) -> DeviceCheck:
    """Whether the bench file has the lens that CameraInfo tells; of rectified images (image_proc) that is P's."""
    if info is None:
        return DeviceCheck(f"camera {role}: its lens", f"nothing comes on {settings.info}")
    setup: CameraSetup = getattr(bench, role)
    rectified = RECTIFIED in settings.topic
    matrix = np.reshape(info.p, (3, 4))[:, :3] if rectified else np.reshape(info.k, (3, 3))
    bends = np.array([*([] if rectified else info.d), *[0.0] * 5])
    brown = not bends.any() or (info.distortion_model in BROWN and not bends[5:].any())
    odd = "" if brown else f"its distortion is {info.distortion_model!r}: publish rectified images"
    return cameras.lens_check(role, setup, (info.width, info.height), matrix, bends[:5], odd)
