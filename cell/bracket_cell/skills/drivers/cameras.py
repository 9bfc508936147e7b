"""Cameras: a thread grabs for ever, and the newest frame wins. USB (V4L2), network (MJPEG, RTSP) and video files."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from bracket_cell.skills.drivers.settings import (
    DRIVERS,
    CameraDriverSettings,
    FileSettings,
    StreamSettings,
    V4l2Settings,
)
from bracket_ground.errors import DeviceFault, words_of
from bracket_ground.interfaces.bench import Bench, CameraSetup
from bracket_ground.interfaces.clock import Clock
from bracket_ground.interfaces.devices import DeviceCheck
from bracket_ground.interfaces.frame import Frame, apart
from bracket_ground.interfaces.intrinsics import Lens
from bracket_ground.interfaces.pose import Array

OPEN_MS, READ_MS = 3000, 500  # after which a stream that is silent is given up; OpenCV waits 30 s by itself
RETRY_S = 0.2  # after which a camera that is gone is opened again
CLOSES_S = 2.0  # in which a camera that is let go of has done so; a driver may wait for an image that never comes
AT_ONCE_SHARE = 0.25  # of a period: a frame that comes sooner after the one before waited in a buffer
LOOKED_S, OLD_S, SLOW, DARK = 2.0, 0.2, 0.8, 8.0  # of `examine`: how long; share of the rate; mean grey level
LEAST_DEPTH = 0.8  # of `examine`: share of a standing bench's pixels that a stereo camera knows the depth of
FOCAL_OFF, CENTRE_OFF_PX, BENDS_OFF = 0.02, 16.0, 0.02  # of `lens_check`: what may differ from the bench file. A k1
# of .02 moves the corners of 640 x 480 pixels (focal length 600) by 4 px.
GRANTED = 0.02  # share by which a granted setting may differ from what was asked for
FIXED = 1.0  # V4L2: exposure by hand
LISTS = (b"ffconcat", b"#EXTM3U")  # FFmpeg plays the files that such a text names, whatever its own name is
Image = NDArray[np.uint8]
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # quiet: what it has to say is raised, too
cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_ERROR)


class Source(Protocol):
    """A camera that is open."""

    def grab(self) -> tuple[Image, float | None]:
        """Wait for the next image, in RGB.

        Returns:
            the image, with depth as in `Frame.pixels` where the source has it, and how long ago the driver stamped it
            [s]; None where it does not stamp.

        Raises:
            OSError: none came.
        """
        ...

    def close(self) -> None:
        """Let go of it."""
        ...


class GrabbingCamera:
    """Implements `Camera` over any source; it is opened again where it is lost.

    Frames of a wrist camera tell where it is at the tool; who reads them knows where the arm was. A camera that the
    bench file calls triggered hands out the first frame that was taken after a trigger.

    Args:
        open_source: raises OSError where there is none.

    Attributes:
        lens: as the camera itself knows it; None where it knows none.
    """

    def __init__(
        self,
        settings: CameraDriverSettings,
        clock: Clock,
        bench: Bench,
        role: str,
        open_source: Callable[[CameraSetup], Source],
    ) -> None:
        self._setup: CameraSetup = getattr(bench, role).drawn
        self._name, self._settings, self._clock = role, settings, clock
        self._open_source = open_source
        self._lock, self._closed = threading.Lock(), threading.Event()
        self._newest: Frame | None = None
        self._handed: Frame | None = None
        self._asked_s: float | None = None
        self._came_s, self._trouble, self._sequence = clock.now_s(), "no frame yet", -1
        try:
            self._source: Source | None = open_source(self._setup)
        except Exception as error:  # whatever a driver raises, as when it is opened again
            raise self._fault(f"cannot be opened: {_words(error)}") from error
        self.lens: Lens | None = getattr(self._source, "lens", None)
        self._thread = threading.Thread(target=self._run, name=f"camera {role}", daemon=True)
        self._thread.start()

    def trigger(self) -> None:
        """Hand out the next frame that is taken from now on."""
        self._asked_s = self._clock.now_s() if self._asked_s is None else self._asked_s

    def latest(self) -> Frame | None:
        """The newest frame; raises DeviceFault where none came for `lost_s`."""
        with self._lock:
            newest, silent_s, trouble = self._newest, self._clock.now_s() - self._came_s, self._trouble
        if silent_s > self._settings.lost_s:
            raise self._fault(f"no frame for {silent_s:.2f} s: {trouble}")
        if not self._setup.triggered:
            return newest
        if self._asked_s is not None and newest is not None and newest.time_s > self._asked_s:
            self._handed, self._asked_s = newest, None
        return self._handed

    def close(self) -> None:
        """Let go of the camera, within two seconds; one that waits for an image is let go of when it comes."""
        self._closed.set()
        self._thread.join(CLOSES_S)

    def _fault(self, what: str) -> DeviceFault:
        return DeviceFault(f"camera {self._name}", what)

    def _run(self) -> None:
        while not self._closed.is_set():
            try:
                self._grab()
            except Exception as error:  # whatever a driver raises: it is told, and the camera opened again
                self._lost(error)
                self._closed.wait(RETRY_S)
        self._let_go()

    def _lost(self, error: Exception) -> None:
        with self._lock:
            self._trouble = _words(error)
        try:
            self._let_go()
        except Exception as other:
            with self._lock:
                self._trouble += f"; {_words(other)}"

    def _grab(self) -> None:
        if self._source is None:
            self._source, self._sequence = self._open_source(self._setup), -1
        asked_s = time.monotonic()
        pixels, ago_s = self._source.grab()
        waited_s = time.monotonic() - asked_s
        self._sequence += 1
        if ago_s is None and waited_s < AT_ONCE_SHARE / self._setup.rate_hz:
            return  # nobody knows how long it waited in a buffer
        image, depth_mm = apart(pixels)
        wanted = self._setup.height_px, self._setup.width_px
        if image.shape[:2] != wanted:
            text = f"{image.shape[1]} x {image.shape[0]} pixels, the bench file says {wanted[1]} x {wanted[0]}"
            raise OSError(f"its images have {text}")
        if self._setup.depth and depth_mm is None:
            raise OSError(
                f"it sends no depths, and bench.{self._name}.depth is true; legal: a RealSense or a topic, or false"
            )
        now_s = self._clock.now_s()
        taken_s = now_s - (ago_s or 0.0) - (self._settings.delay_s or 0.0)
        mount, at_tool = self._setup.mount.pose, self._name == "wrist"
        frame = Frame(self._name, self._sequence, taken_s, image, mount, at_tool=at_tool, depth_mm=depth_mm)
        with self._lock:
            if self._newest is None or taken_s > self._newest.time_s:
                self._newest = frame
            self._came_s, self._trouble = now_s, ""

    def _let_go(self) -> None:
        source, self._source = self._source, None
        if source is not None:
            source.close()


def _words(error: Exception) -> str:
    """What a driver raised, on one line: an OSError says all in its words, others in their type, too."""
    text = " ".join(words_of(error).split())
    return text if isinstance(error, OSError) and text else f"{type(error).__name__}: {text}"


class _Capture:
    """Implements `Source` by OpenCV.

    Raises:
        OSError: it cannot be opened.
    """

    def __init__(self, what: str, backend: int, parameters: Mapping[int, float]) -> None:
        given = [int(value) for pair in parameters.items() for value in pair]
        self.capture = cv2.VideoCapture(what, backend, given)
        if not self.capture.isOpened():
            raise OSError(f"{what} cannot be opened")

    def grab(self) -> tuple[Image, float | None]:
        """As in `Source`."""
        there, image = self.capture.read()
        if not there or image is None:
            raise OSError("it sends no more images")
        if image.ndim != 3 or image.shape[2] != 3 or not image.size:
            raise OSError(f"it sends no colour images: their shape is {image.shape}, not (height, width, 3)")
        return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8), self._ago_s()

    def close(self) -> None:
        """As in `Source`."""
        self.capture.release()

    def _ago_s(self) -> float | None:
        return None


class StreamCamera(GrabbingCamera):
    """A camera on the network; its stamp is when the image came."""

    Settings = StreamSettings

    def __init__(self, settings: StreamSettings, clock: Clock, bench: Bench, role: str) -> None:
        slower = getattr(clock, "slower", 1.0)
        limits = {cv2.CAP_PROP_OPEN_TIMEOUT_MSEC: OPEN_MS * slower, cv2.CAP_PROP_READ_TIMEOUT_MSEC: READ_MS * slower}
        super().__init__(settings, clock, bench, role, lambda _: _Capture(settings.url, cv2.CAP_FFMPEG, limits))


class _V4l2(_Capture):
    """A USB camera with exposure, focus and white balance fixed."""

    def __init__(self, settings: V4l2Settings, setup: CameraSetup) -> None:
        device = os.path.realpath(settings.device)  # the name by id leads to the number of today
        fixed = {
            cv2.CAP_PROP_FOURCC: cv2.VideoWriter.fourcc(*settings.fourcc),
            cv2.CAP_PROP_FRAME_WIDTH: setup.width_px,
            cv2.CAP_PROP_FRAME_HEIGHT: setup.height_px,
            cv2.CAP_PROP_FPS: setup.rate_hz,
            cv2.CAP_PROP_BUFFERSIZE: 1,
            cv2.CAP_PROP_AUTO_WB: 0,
            cv2.CAP_PROP_AUTO_EXPOSURE: FIXED,
            cv2.CAP_PROP_EXPOSURE: settings.exposure,
        }
        if settings.focus is not None:
            fixed |= {cv2.CAP_PROP_AUTOFOCUS: 0, cv2.CAP_PROP_FOCUS: settings.focus}
        super().__init__(device, cv2.CAP_V4L2, {})
        for setting, value in fixed.items():
            self.capture.set(setting, value)
        for setting in (cv2.CAP_PROP_AUTO_EXPOSURE, cv2.CAP_PROP_EXPOSURE, cv2.CAP_PROP_FOCUS):
            granted = self.capture.get(setting)
            if setting in fixed and abs(granted - fixed[setting]) > GRANTED * max(1.0, abs(fixed[setting])):
                self.close()
                raise OSError(f"{settings.device} takes no {NAMES[setting]} of {fixed[setting]:g}: it has {granted:g}")

    def _ago_s(self) -> float | None:
        """By the driver's stamp, which is of the machine's monotonic clock."""
        stamp_ms = self.capture.get(cv2.CAP_PROP_POS_MSEC)
        ago_s = time.monotonic() - stamp_ms / 1000
        return ago_s if stamp_ms > 0 and 0 <= ago_s < 10 else None


NAMES = {
    cv2.CAP_PROP_AUTO_EXPOSURE: "fixed exposure (auto_exposure)",
    cv2.CAP_PROP_EXPOSURE: "exposure",
    cv2.CAP_PROP_FOCUS: "focus",
}


class V4l2Camera(GrabbingCamera):
    """A USB camera on Linux."""

    Settings = V4l2Settings

    def __init__(self, settings: V4l2Settings, clock: Clock, bench: Bench, role: str) -> None:
        super().__init__(settings, clock, bench, role, lambda setup: _V4l2(settings, setup))


class _Film(_Capture):
    """A video file, at the pace of a camera."""

    def __init__(self, path: Path, repeat: bool, period_s: float) -> None:
        super().__init__(str(path), cv2.CAP_FFMPEG, {})
        self._path, self._repeat, self._period_s, self._due_s = path, repeat, period_s, time.monotonic()

    def grab(self) -> tuple[Image, float | None]:
        """As in `Source`."""
        self._due_s = max(self._due_s + self._period_s, time.monotonic())
        time.sleep(max(0.0, self._due_s - time.monotonic()))
        try:
            return super().grab()
        except OSError:
            if not self._repeat:
                raise
            self.capture.open(str(self._path), cv2.CAP_FFMPEG)  # a film of one image cannot be wound back
            return super().grab()

    def _ago_s(self) -> float | None:
        return 0.0


def is_list(path: Path) -> bool:
    """Whether a file is no film, but names others; raises OSError where it cannot be read."""
    with path.open("rb") as file:
        return file.read(8).startswith(LISTS)


class FileCamera(GrabbingCamera):
    """A video file in place of a camera."""

    Settings = FileSettings

    def __init__(self, settings: FileSettings, clock: Clock, bench: Bench, role: str) -> None:
        def film(setup: CameraSetup) -> Source:
            if hasattr(self, "_thread") and not settings.repeat:
                raise OSError("the film is over")
            if not settings.path.is_file():  # a pipe waits for its writer
                raise OSError(f"{settings.path} is no file")
            if is_list(settings.path):
                raise OSError(f"{settings.path} is a list of other files, not a film")
            return _Film(settings.path, settings.repeat, 1.0 / setup.rate_hz)

        super().__init__(settings, clock, bench, role, film)


def examine(settings: CameraDriverSettings, clock: Clock, bench: Bench, role: str) -> Iterator[DeviceCheck]:
    """Images for two seconds: rate, age, and whether they show anything."""
    module, _, name = DRIVERS[type(settings)].partition(":")
    what, rate_hz = f"camera {role}", getattr(bench, role).rate_hz
    try:
        camera: GrabbingCamera = getattr(import_module(module), name)(settings, clock, bench, role)
    except DeviceFault as error:
        hints = {V4l2Settings: ": check cable and address; names by id: ls /dev/v4l/by-id", FileSettings: ""}
        yield DeviceCheck(what, error.reason + hints.get(type(settings), ": check cable and address"))
        return
    frames: list[Frame] = []
    begun_s = clock.now_s()
    try:
        while clock.now_s() < begun_s + LOOKED_S:
            camera.trigger()
            frame = camera.latest()
            if frame is not None and (not frames or frame is not frames[-1]):
                frames.append(frame)
            clock.sleep_until(clock.now_s() + 0.2 / rate_hz)
        age_s = clock.now_s() - frames[-1].time_s if frames else float("inf")
    except DeviceFault as error:
        yield DeviceCheck(what, f"{error.reason}")
        return
    finally:
        camera.close()
    if (lens := camera.lens) is not None:
        seen = getattr(bench, role).model_copy(update=lens.model_dump()).model
        size = seen.width_px, seen.height_px
        yield lens_check(role, getattr(bench, role), size, seen.matrix, np.array(seen.distortion))
    yield _of_frames(what, frames, rate_hz, age_s)
    if frames and (depth_mm := frames[-1].depth_mm) is not None:
        share = float((depth_mm > 0).mean())
        text = f"{what}: depth of {share:.0%} of the image"
        yield DeviceCheck(text, "" if share >= LEAST_DEPTH else "too little: glare, bare steel, or a camera too near")
    text = f"{what}: stamps {1e3 * (settings.delay_s or 0.0):.0f} ms after the exposure"
    yield DeviceCheck(
        text if settings.delay_s is not None else f"{what}: how late its stamps are",
        "" if settings.delay_s is not None else "not known: `cell setup calibrate` measures it: delay_s",
    )


def lens_check(
    role: str, setup: CameraSetup, size_px: tuple[int, int], matrix: Array, bends: Array, odd: str = ""
) -> DeviceCheck:
    """Whether the bench file has the lens that a camera tells.

    Args:
        matrix: (3, 3) as OpenCV has it.
        bends: (5,) k1, k2, p1, p2, k3.
        odd: why its distortion is none of these; empty where it is.
    """
    fx, fy, cx, cy = matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]
    text = f"camera {role}: focal lengths {fx:.1f}, {fy:.1f}, principal point {cx:.1f}, {cy:.1f} of "
    text += "{} x {} pixels".format(*size_px)
    model, (column, row) = setup.model, setup.model.middle_px
    if size_px != (setup.width_px, setup.height_px):
        return DeviceCheck(text, f"the bench file says {setup.width_px} x {setup.height_px}")
    if np.abs(np.array([fx, fy]) / model.focals_px - 1).max() > FOCAL_OFF:
        return DeviceCheck(text, "the bench file says focal_px: {:g}, focal_y_px: {:g}".format(*model.focals_px))
    if max(abs(cx - column), abs(cy - row)) > CENTRE_OFF_PX:
        return DeviceCheck(text, f"the bench file says principal_px: [{column:g}, {row:g}]")
    if odd:
        return DeviceCheck(text, odd)
    if np.abs(bends - model.distortion).max() > BENDS_OFF:
        what = "the bench file says k1, k2, p1, p2, k3 = {:g}, {:g}, {:g}, {:g}, {:g}".format(*model.distortion)
        return DeviceCheck(text, f"{what}; its images {', '.join(f'{value:g}' for value in bends)}")
    return DeviceCheck(text)


def _of_frames(what: str, frames: list[Frame], rate_hz: float, age_s: float) -> DeviceCheck:
    if len(frames) < 2:
        return DeviceCheck(what, f"no image in {LOOKED_S:g} s")
    found_hz = (len(frames) - 1) / (frames[-1].time_s - frames[0].time_s)
    text = f"{what}: {found_hz:.1f} images per second, the newest {1e3 * age_s:.0f} ms old"
    if found_hz < SLOW * rate_hz:
        return DeviceCheck(text, f"rate_hz says {rate_hz:g}: a USB port of its own, less exposure, or a lower rate_hz")
    if age_s > OLD_S + 2 / rate_hz:
        return DeviceCheck(text, "too old: less buffering in the camera, or another way to it")
    if max(float(np.mean(frame.image)) for frame in frames) < DARK:
        return DeviceCheck(text, "they are black: take the cover off, light the bench, or raise exposure")
    if all(np.array_equal(frames[0].image, frame.image) for frame in frames[1:]):
        return DeviceCheck(text, "they are all the same: the camera is frozen; unplug it for a moment")
    return DeviceCheck(text)
