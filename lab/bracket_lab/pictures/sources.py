"""Frames to look at or to record: pictures, folders of them, videos, cameras, logs, and the simulated cell."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from bracket_cell.configuration import Configuration
from bracket_cell.learned.records import read_image
from bracket_cell.log.read.frames import Frames
from bracket_cell.log.read.reader import read_log
from bracket_cell.plugins import attribute
from bracket_cell.skills.drivers.cameras import is_list
from bracket_cell.skills.motion.kinematics import Kinematics
from bracket_ground.errors import InputError, LogError, words_of
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.product import Product

PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".webp")
VIDEOS = (".mp4", ".m4v", ".mpg", ".avi", ".mov", ".mkv", ".webm", ".wmv", ".gif", ".3gp", ".mts", ".ts", ".flv")
RATES_HZ = (0.1, 960.0)  # from time lapse to the slow motion of a telephone; others are slips of a container
MISSING = 2  # frames: a sound video may have one less than it tells, and fewer, but as late ones, if its rate varies
LEGAL = "an image, a folder of images, a video, a log (.mcap), camera:NUMBER, or sim:SEED"


@dataclass(frozen=True)
class Source:
    """A stream of frames.

    Attributes:
        name: for files that are made of it.
        single: it is one picture.
        follows: frames follow each other in time; pictures need not, not even those of one folder.
        rate_hz: of frames in a video of it.
        files: of a folder of images, by the frame's number.
    """

    name: str
    single: bool
    follows: bool
    rate_hz: float
    frames: Iterator[Frame]
    files: tuple[str, ...] = ()

    def title(self, number: int) -> str:
        """What the picture of a frame is called: as the image is, where no other one is called so."""
        if not self.files:
            return f"{number:06d}"
        stem = Path(self.files[number]).stem
        alone = sum(Path(file).stem == stem for file in self.files) == 1
        return stem if alone else self.files[number]


def camera_pose(bench: Bench, camera: str) -> Pose:
    """Where a camera is; the one on the wrist where it looks into the tray."""
    if camera == "overhead":
        return bench.overhead.mount.pose
    return Kinematics().forward(np.array(bench.arm_look_rad)) @ bench.wrist.mount.pose


def open_source(
    text: str, camera: str, configuration: Configuration, product: Product, world_from_camera: Pose
) -> Source:
    """What `cell record` or `cell lab see` was given.

    Args:
        camera: "overhead" or "wrist", as which frames are taken.
        world_from_camera: where it is.

    Raises:
        InputError, LogError: there is no such source, or it cannot be read.
    """
    kind, _, number = text.partition(":")
    if kind in ("camera", "sim") and number:
        if not number.isdecimal():
            raise InputError(f"{text}: {number!r} must be a whole number from 0 on, as in {kind}:7")
        if kind == "camera":
            return _video(int(number), f"camera{number}", camera, world_from_camera)
        return _simulated(int(number), camera, configuration, product)
    path = Path(text)
    if path.is_dir():
        files = sorted(file for file in path.iterdir() if file.suffix.lower() in PICTURES)
        if not files:
            raise InputError(f"{path}: holds no images ({', '.join(PICTURES)})")
        name = path.resolve().name.replace(".", "-")  # what follows a dot would say which kind of file is written
        frames = _pictures(files, camera, world_from_camera)
        return Source(name, False, False, 2.0, frames, tuple(file.name for file in files))
    if not path.is_file():
        raise InputError(f"{text}: there is no such file, nor a source of that name; legal: {LEGAL}")
    suffix = path.suffix.lower()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)  # what it has to say is raised
    if suffix in PICTURES and cv2.imcount(str(path)) > 1:
        return _moving_picture(path, camera, world_from_camera)
    if suffix in PICTURES:
        return Source(path.stem, True, False, 2.0, _pictures([path], camera, world_from_camera))
    if suffix in VIDEOS:
        if _is_list(path):
            raise InputError(f"{path}: is a list of other files, which are not opened; legal: {LEGAL}")
        return _video(str(path), path.stem, camera, world_from_camera)
    if suffix == ".mcap":
        return _log(path, camera, world_from_camera)
    raise InputError(f"{path}: is of no known kind; legal: {LEGAL}; endings: {', '.join(PICTURES + VIDEOS)}")


def _is_list(path: Path) -> bool:
    try:
        return is_list(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {words_of(error)}") from None


def _pictures(files: list[Path], camera: str, pose: Pose) -> Iterator[Frame]:
    """What can be read; the rest is said on standard error, or, where nothing can be read, refused."""
    unread = []
    for number, file in enumerate(files):
        try:
            yield Frame(camera, number, 0.0, read_image(file), pose)
        except InputError as error:
            unread.append(file)
            if len(unread) == len(files):
                raise
            sys.stderr.write(f"cell: left out: {error}\n")
        else:
            if cv2.imcount(str(file)) > 1:
                sys.stderr.write(f"cell: {file}: moves: its first picture alone is taken; name the file for all\n")


def _moving_picture(path: Path, camera: str, pose: Pose) -> Source:
    there, moving = cv2.imreadanimation(str(path))
    if not there:
        raise InputError(f"{path}: cannot be read as a moving image: damaged, or too large")
    starts_s = np.cumsum([0, *np.maximum(moving.durations, 10)]) / 1e3  # some tell none: browsers wait, too
    frames = (_frame(camera, n, float(starts_s[n]), image[..., :3], pose) for n, image in enumerate(moving.frames))
    return Source(path.stem, False, True, len(moving.frames) / float(starts_s[-1]), frames)


def _video(source: str | int, name: str, camera: str, pose: Pose) -> Source:
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # quiet: what it has to say is raised
    capture = cv2.VideoCapture(source, cv2.CAP_ANY if isinstance(source, int) else cv2.CAP_FFMPEG)  # AVI's own talks
    if not capture.isOpened():
        named = f"camera:{source}" if isinstance(source, int) else source
        raise InputError(f"{named}: cannot be opened as a {'camera' if isinstance(source, int) else 'video'}")
    fps, told_frames = capture.get(cv2.CAP_PROP_FPS), capture.get(cv2.CAP_PROP_FRAME_COUNT)
    rate_hz = float(fps) if RATES_HZ[0] <= fps <= RATES_HZ[1] else 15.0

    def frames() -> Iterator[Frame]:
        number, begun_s, time_s = 0, 0.0, 0.0
        while True:
            there, image = capture.read()
            if not there:
                break
            at_s = capture.get(cv2.CAP_PROP_POS_MSEC) / 1e3 - begun_s
            if number == 0:
                begun_s = at_s
            else:  # the rate may vary; some containers tell no times
                time_s = at_s if at_s > time_s else time_s + 1 / rate_hz
            yield _frame(camera, number, time_s, image, pose)
            number += 1
        if number == 0:
            codec = np.int64(capture.get(cv2.CAP_PROP_FOURCC)).tobytes()[:4].decode("ascii", "replace")
            raise InputError(f"{source}: no frame can be read: damaged, or a codec ({codec}) that is unknown here")
        capture.release()
        lasted_s = time_s + 1 / rate_hz
        if told_frames - max(number, lasted_s * rate_hz) >= MISSING:
            until = f"{lasted_s:.1f} of {told_frames / rate_hz:.1f} s"
            sys.stderr.write(f"cell: {source}: ends early: {until} could be read ({number} frames)\n")

    return Source(name, False, True, rate_hz, frames())


def _log(path: Path, camera: str, pose: Pose) -> Source:
    log = read_log(path)
    if log.unfinished:
        sys.stderr.write(f"cell: {path}: {log.unfinished}\n")
    times_s = (stored := Frames(log)).times_s(camera)
    if not times_s:
        raise LogError(path, f"holds no frames of the camera {camera} (configuration: log.camera_frames)")

    def frames() -> Iterator[Frame]:
        for number, time_s in enumerate(times_s):
            found = stored.at(camera, time_s)
            assert found is not None
            png = stored.depth_at(camera, time_s)
            depth = None if png is None else cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_UNCHANGED)
            yield replace(
                _frame(camera, number, time_s, found.image(), pose),
                depth_mm=None if depth is None else np.asarray(depth, np.uint16),
            )

    lasting_s = times_s[-1] - times_s[0]
    return Source(path.stem, False, True, (len(times_s) - 1) / lasting_s if lasting_s > 0 else 15.0, frames())


def _simulated(seed: int, camera: str, configuration: Configuration, product: Product) -> Source:
    """The person alone before the overhead camera."""
    if camera != "overhead":
        raise InputError(f"sim:{seed}: shows the overhead camera only; for others see: cell lab data objects")
    try:
        draw = attribute("bracket_lab.wiring.drawn_frames:overhead_frames")
    except ModuleNotFoundError as error:
        raise InputError(f"sim:{seed}: needs the laboratory, which draws such frames ({error})") from None
    frames = draw(configuration, product, seed)
    return Source(f"sim{seed}", False, True, configuration.bench.overhead.rate_hz, frames)


def _frame(camera: str, number: int, time_s: float, bgr: Any, pose: Pose) -> Frame:
    return Frame(camera, number, time_s, np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), np.uint8), pose)
