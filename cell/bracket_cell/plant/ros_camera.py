"""A camera that a node of ROS 2 publishes, as sensor_msgs/Image or CompressedImage."""

from __future__ import annotations

import time
from typing import Any

import cv2
import numpy as np

from bracket_cell.packages import needed
from bracket_cell.plant.dds import Node, Quality
from bracket_cell.plant.ros_types import PACKAGE_OF
from bracket_cell.skills.drivers.cameras import GrabbingCamera, Image
from bracket_cell.skills.drivers.settings import Ros2CameraSettings
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.clock import Clock

FRAME_S = 1.0  # in which a frame must come
OLDEST_S = 10.0  # a stamp that is farther from the wall clock is of another clock, as of a simulation
SENSOR = Quality(reliable=False, kept=1)  # rmw_qos_profile_sensor_data; it hears reliable publishers, too
COMPRESSED = "/compressed"
TO_RGB = {
    "rgb8": None,
    "bgr8": cv2.COLOR_BGR2RGB,
    "rgba8": cv2.COLOR_RGBA2RGB,
    "bgra8": cv2.COLOR_BGRA2RGB,
}  # by encoding: sensor_msgs/image_encodings.hpp


class _Subscribed:
    """Implements `Source`."""

    def __init__(self, settings: Ros2CameraSettings) -> None:
        kind = "CompressedImage" if settings.topic.endswith(COMPRESSED) else "Image"
        self._topic = settings.topic
        self._reader: Any = Node(settings).subscription(settings.topic, f"sensor_msgs/msg/{kind}", SENSOR)
        self._util = needed("cyclonedds.util", PACKAGE_OF, "ros2")

    def grab(self) -> tuple[Image, float | None]:
        """As in `Source`."""
        came = next(self._reader.take_iter(timeout=self._util.duration(seconds=FRAME_S)), None)
        if came is None:
            raise OSError(f"nothing comes on {self._topic}")
        stamp_s = came.header.stamp.sec + came.header.stamp.nanosec * 1e-9
        ago_s = time.time() - stamp_s
        image = _decoded(came) if self._topic.endswith(COMPRESSED) else _image(came)
        return image, ago_s if 0 <= ago_s <= OLDEST_S else None

    def close(self) -> None:
        """As in `Source`."""
        self._reader = None


class Ros2Camera(GrabbingCamera):
    """A camera of ROS 2."""

    Settings = Ros2CameraSettings

    def __init__(self, settings: Ros2CameraSettings, clock: Clock, bench: Bench, role: str) -> None:
        super().__init__(settings, clock, bench, role, lambda _: _Subscribed(settings))


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
    image = cv2.imdecode(np.frombuffer(bytes(came.data), np.uint8), cv2.IMREAD_COLOR_RGB)
    if image is None:
        raise OSError("a compressed image cannot be decoded")
    return np.asarray(image, np.uint8)
