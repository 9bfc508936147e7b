"""An Intel RealSense, depths aligned to its colours. Never tried on hardware; needs pyrealsense2 and libusb-1.0."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pyrealsense2
from numpy.typing import NDArray
from pydantic import ValidationError

from bracket_cell.skills.drivers.cameras import GrabbingCamera, Image
from bracket_cell.skills.drivers.settings import RealsenseSettings
from bracket_ground.interfaces.bench import Bench, CameraSetup
from bracket_ground.interfaces.clock import Clock
from bracket_ground.interfaces.frame import together
from bracket_ground.interfaces.intrinsics import Lens

FRAME_MS = 1000  # in which a frame must come
OLDEST_S = 10.0  # a stamp from before it, or from the future, is of a clock that is not this machine's
MOST_MM = np.iinfo(np.uint16).max
Mode = tuple[int, int, int]  # width, height, images a second


class _Pipeline:
    """Implements `Source`.

    Attributes:
        lens: of the colour images, as the camera was calibrated by its maker; None where it is of another model.

    Raises:
        OSError: there is no such camera, or it does not take the settings.
    """

    def __init__(self, settings: RealsenseSettings, setup: CameraSetup) -> None:
        self._number = -1
        self._pipeline = pyrealsense2.pipeline()
        config = pyrealsense2.config()
        if settings.serial is not None:
            config.enable_device(settings.serial)
        mode = setup.width_px, setup.height_px, round(setup.rate_hz)
        stream, pixel = pyrealsense2.stream, pyrealsense2.format
        config.enable_stream(stream.color, *mode[:2], pixel.rgb8, mode[2])
        if setup.depth:
            config.enable_stream(stream.depth, *mode[:2], pixel.z16, mode[2])
        self._align = pyrealsense2.align(stream.color) if setup.depth else None
        try:
            profile = self._pipeline.start(config)
        except RuntimeError as error:
            raise OSError(f"RealSense: {error}{_legal(mode, setup.depth)}") from error
        try:
            device, video = profile.get_device(), profile.get_stream(stream.color).as_video_stream_profile()
            self.lens = _lens(video.get_intrinsics())
            self._mm = 1e3 * device.first_depth_sensor().get_depth_scale() if setup.depth else 0.0
            sensor, option = device.first_color_sensor(), pyrealsense2.option
            sensor.set_option(option.enable_auto_exposure, 0.0)
            sensor.set_option(option.enable_auto_white_balance, 0.0)
            sensor.set_option(option.exposure, settings.exposure)
            sensor.set_option(option.global_time_enabled, 1.0)
        except RuntimeError as error:
            self.close()
            raise OSError(f"RealSense: {error}") from error

    def grab(self) -> tuple[Image, float | None]:
        """As in `Source`; a frame that comes twice is taken once, and stamps of the camera's own clock for none."""
        until_s = time.monotonic() + FRAME_MS / 1000
        while True:
            try:
                frames: Any = self._pipeline.wait_for_frames(FRAME_MS)
                frames = frames if self._align is None else self._align.process(frames)
            except RuntimeError as error:
                raise OSError(f"RealSense: {error}") from error
            frame = frames.get_color_frame()
            if frame and frame.get_frame_number() != self._number:
                break
            if time.monotonic() > until_s:
                raise OSError("RealSense: it sends one image again and again")
        self._number = frame.get_frame_number()
        of_host = frame.get_frame_timestamp_domain() == pyrealsense2.timestamp_domain.global_time
        ago_s = time.time() - frame.get_timestamp() / 1000 if of_host else -1.0
        image = np.asanyarray(frame.get_data()).astype(np.uint8)
        stamped_s = ago_s if 0 <= ago_s < OLDEST_S else None
        return image if self._align is None else together(image, self._depth_mm(frames)), stamped_s

    def _depth_mm(self, frames: Any) -> NDArray[np.uint16]:
        """Depths by the pixels of the colour image; 0 where none is known."""
        if not (depth := frames.get_depth_frame()):
            raise OSError("RealSense: a colour image came without its depths")
        depth_mm = np.rint(np.asanyarray(depth.get_data()) * self._mm)
        return np.where(depth_mm <= MOST_MM, depth_mm, 0).astype(np.uint16)

    def close(self) -> None:
        """As in `Source`."""
        self._pipeline.stop()


def _lens(lens: Any) -> Lens | None:
    """A lens of librealsense; none where its bends are of another model than OpenCV's, or such as no lens has."""
    if any(lens.coeffs) and lens.model != pyrealsense2.distortion.brown_conrady:
        return None
    try:
        return Lens.opencv([[lens.fx, 0.0, lens.ppx], [0.0, lens.fy, lens.ppy], [0.0, 0.0, 1.0]], lens.coeffs)
    except ValidationError:
        return None


def _legal(asked: Mode, depth: bool) -> str:
    """Which modes a connected camera has instead of one that it has not; empty where there is no camera."""
    sensors = [sensor for device in pyrealsense2.context().query_devices() for sensor in device.query_sensors()]
    wanted = {pyrealsense2.stream.color: pyrealsense2.format.rgb8}
    wanted |= {pyrealsense2.stream.depth: pyrealsense2.format.z16} if depth else {}
    modes: dict[Any, set[Mode]] = {stream: set() for stream in wanted}
    for profile in (profile for sensor in sensors for profile in sensor.get_stream_profiles()):
        if wanted.get(profile.stream_type()) == profile.format():
            seen = profile.as_video_stream_profile()
            modes[profile.stream_type()].add((seen.width(), seen.height(), seen.fps()))
    both = set.intersection(*modes.values())
    if not both or asked in both:
        return ""
    text = ", ".join(f"{width} x {height} at {rate}" for width, height, rate in sorted(both))
    return f"; it has no {asked[0]} x {asked[1]} at {asked[2]} images a second; legal: {text}"


class RealsenseCamera(GrabbingCamera):
    """A RealSense."""

    Settings = RealsenseSettings

    def __init__(self, settings: RealsenseSettings, clock: Clock, bench: Bench, role: str) -> None:
        super().__init__(settings, clock, bench, role, lambda setup: _Pipeline(settings, setup))
