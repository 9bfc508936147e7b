"""Camera images of a log, as JPEG files; nothing is decoded before it is asked for."""

from __future__ import annotations

import base64
from bisect import bisect_left, bisect_right
from collections import defaultdict
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from foxglove import messages
from google.protobuf.message import DecodeError

from bracket_cell.log.read.mcap_file import Message
from bracket_cell.log.read.reader import Log
from bracket_cell.recording.viewed import message_class
from bracket_ground.errors import LogError
from bracket_ground.interfaces.observation import Image

IMAGE, LINE = messages.CompressedImage, messages.Log
CAMERA, DEPTH = "/camera/", "/depth/"


def decoded(path: Path, message: Message, kind: Any) -> Any:
    """A message's fields.

    Args:
        path: of the log, for errors.
        kind: class of `foxglove.messages`.

    Raises:
        LogError: the message is none of this kind.
    """
    try:
        return message_class(kind).FromString(message.data)
    except DecodeError:
        what = f"message of {message.topic} at {message.time_ns / 1e9:.3f} s is not a valid {kind.__name__}"
        raise LogError(path, what) from None


@dataclass(frozen=True)
class LoggedFrame:
    """One image as it was logged in the file `path`."""

    path: Path
    camera: str
    time_s: float
    jpeg: bytes

    def image(self) -> Image:
        """(height, width, 3) in BGR, as OpenCV has it.

        Raises:
            LogError: it cannot be decoded.
        """
        with suppress(cv2.error):  # it is empty, or says that it is enormous
            if (image := cv2.imdecode(np.frombuffer(self.jpeg, np.uint8), cv2.IMREAD_COLOR)) is not None:
                return np.asarray(image, np.uint8)
        raise LogError(self.path, f"the image of camera {self.camera} at {self.time_s:.3f} s cannot be decoded")

    @property
    def uri(self) -> str:
        """For an HTML page."""
        return "data:image/jpeg;base64," + base64.b64encode(self.jpeg).decode()


class Frames:
    """Images of a log by camera and time."""

    def __init__(self, log: Log) -> None:
        self._path = log.path
        self._messages: dict[str, list[Message]] = defaultdict(list)
        self._depths: dict[str, dict[int, Message]] = defaultdict(dict)  # by camera and time
        for message in log.messages:
            if message.topic.startswith(CAMERA) and "/" not in message.topic.removeprefix(CAMERA):
                self._messages[message.topic.removeprefix(CAMERA)].append(message)
            elif message.topic.startswith(DEPTH):
                self._depths[message.topic.removeprefix(DEPTH)][message.time_ns] = message

    def newest(self, time_s: float) -> list[LoggedFrame]:
        """The newest image of every camera at a time."""
        return [frame for camera in self._messages if (frame := self.newest_of(camera, time_s)) is not None]

    def newest_of(self, camera: str, time_s: float) -> LoggedFrame | None:
        """The newest image of a camera at a time; None where there is none yet."""
        written = self._messages.get(camera, [])
        count = bisect_right(written, round(time_s * 1e9), key=lambda message: message.time_ns)
        return self._frame(camera, written[count - 1]) if count else None

    def times_s(self, camera: str) -> list[float]:
        """When this camera took its images."""
        return [message.time_ns / 1e9 for message in self._messages.get(camera, ())]

    def rate_hz(self, camera: str) -> float:
        """Of its images, two or more; what the recorder left out, as the disk did not keep up, does not change it."""
        steps_s = np.diff(self.times_s(camera))
        return 1 / float(np.mean(steps_s[steps_s < 1.5 * np.median(steps_s)]))

    def at(self, camera: str, time_s: float) -> LoggedFrame | None:
        """The image that a camera took at this very time; None where it is not in the log."""
        written, time_ns = self._messages.get(camera, []), round(time_s * 1e9)
        at = bisect_left(written, time_ns, key=lambda message: message.time_ns)
        if at == len(written) or written[at].time_ns != time_ns:
            return None
        return self._frame(camera, written[at])

    def depth_at(self, camera: str, time_s: float) -> bytes | None:
        """The depths of `at`, a PNG file of [mm]; None where they are not in the log."""
        message = self._depths.get(camera, {}).get(round(time_s * 1e9))
        return None if message is None else self._jpeg(message)

    def save(self, time_s: float, folder: Path, stem: str) -> list[Path]:
        """Write the newest image of every camera as `stem`-camera.jpg."""
        folder.mkdir(parents=True, exist_ok=True)
        paths = []
        for frame in self.newest(time_s):
            paths.append(folder / f"{stem}-{frame.camera}.jpg")
            paths[-1].write_bytes(frame.jpeg)
        return paths

    def _frame(self, camera: str, message: Message) -> LoggedFrame:
        return LoggedFrame(self._path, camera, message.time_ns / 1e9, self._jpeg(message))

    def _jpeg(self, message: Message) -> bytes:
        content: bytes = decoded(self._path, message, IMAGE).data
        if not content:
            raise LogError(self._path, f"image of {message.topic} at {message.time_ns / 1e9:.3f} s holds no data")
        return content
