"""The colour camera of an Intel RealSense. Never tried on hardware; needs the package pyrealsense2 and libusb-1.0."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pyrealsense2

from bracket_cell.skills.drivers.cameras import GrabbingCamera, Image
from bracket_cell.skills.drivers.settings import RealsenseSettings
from bracket_ground.interfaces.bench import Bench, CameraSetup
from bracket_ground.interfaces.clock import Clock

FRAME_MS = 1000  # in which a frame must come


class _Pipeline:
    """Implements `Source`.

    Raises:
        OSError: there is no such camera, or it does not take the settings.
    """

    def __init__(self, settings: RealsenseSettings, setup: CameraSetup) -> None:
        self._number = -1
        self._pipeline = pyrealsense2.pipeline()
        config = pyrealsense2.config()
        if settings.serial is not None:
            config.enable_device(settings.serial)
        size = setup.width_px, setup.height_px
        config.enable_stream(pyrealsense2.stream.color, *size, pyrealsense2.format.rgb8, round(setup.rate_hz))
        try:
            profile = self._pipeline.start(config)
            sensor = profile.get_device().first_color_sensor()
            option = pyrealsense2.option
            for name, value in (
                (option.enable_auto_exposure, 0.0),
                (option.enable_auto_white_balance, 0.0),
                (option.exposure, settings.exposure),
                (option.global_time_enabled, 1.0),
            ):
                sensor.set_option(name, value)
        except RuntimeError as error:
            raise OSError(f"RealSense: {error}") from error

    def grab(self) -> tuple[Image, float | None]:
        """As in `Source`; a frame that comes twice is taken once, and stamps of the camera's own clock for none."""
        while True:
            try:
                frame: Any = self._pipeline.wait_for_frames(FRAME_MS).get_color_frame()
            except RuntimeError as error:
                raise OSError(f"RealSense: {error}") from error
            if frame.get_frame_number() != self._number:
                break
        self._number = frame.get_frame_number()
        of_host = frame.get_frame_timestamp_domain() == pyrealsense2.timestamp_domain.global_time
        ago_s = time.time() - frame.get_timestamp() / 1000 if of_host else None
        return np.asanyarray(frame.get_data()).astype(np.uint8), ago_s

    def close(self) -> None:
        """As in `Source`."""
        self._pipeline.stop()


class RealsenseCamera(GrabbingCamera):
    """The colour camera of a RealSense."""

    Settings = RealsenseSettings

    def __init__(self, settings: RealsenseSettings, clock: Clock, bench: Bench, role: str) -> None:
        super().__init__(settings, clock, bench, role, lambda setup: _Pipeline(settings, setup))
