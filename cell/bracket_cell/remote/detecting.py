"""Detectors in a process of their own; images lie in memory that all processes share.

A place in the memory is used again only when everybody who reads it has done so.
"""

from __future__ import annotations

import math
import mmap
import os
import select
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bracket_cell.remote.channel import Message
from bracket_cell.remote.child import nameless_file
from bracket_cell.remote.worker import PATIENCE_S, Pending, Worker
from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.bench import CameraSetup
from bracket_ground.interfaces.frame import PIXEL_BYTES, Frame, apart
from bracket_ground.interfaces.perception import BenchView, PartsView, Preparing
from bracket_ground.interfaces.pose import Array, Pose

Image = NDArray[np.uint8]
Detect = Callable[[Frame], BenchView | PartsView]
DetectByCamera = Mapping[str, Detect]  # by the camera whose frames they answer

PLACES = 8  # images of a camera that may wait


class Look(Message, frozen=True):
    """Answer a frame.

    Attributes:
        image: as `Frame.pixels`; None where it lies in the shared memory, or will.
        lies: its number there.
    """

    camera: str
    sequence: int
    time_s: float
    world_from_camera: Pose
    robot_m: Array | None = None
    image: Image | None = None
    lies: int = 0


class Prepare(Message, frozen=True):
    """A frame will likely be asked about."""

    camera: str
    sequence: int


class Done(Message, frozen=True):
    """Nothing is to be said."""


class Bench(Message, frozen=True):
    """Answer to an overhead frame."""

    view: BenchView


class Tray(Message, frozen=True):
    """Answer to a wrist frame."""

    view: PartsView


Seen = Bench | Tray


def seen(view: BenchView | PartsView) -> Seen:
    """An answer as it is sent."""
    return Bench(view) if isinstance(view, BenchView) else Tray(view)


class SharedImages:
    """Memory for PLACES images of each camera; each place says which one lies there.

    Args:
        shapes: (height, width, bytes of a pixel) by camera, see `Frame.pixels`.
        handles: of the memory, and of the two ends of a pipe that tells of each image; new ones by default.
    """

    def __init__(self, shapes: Mapping[str, tuple[int, int, int]], handles: tuple[int, ...] | None = None) -> None:
        if handles is None:
            with nameless_file() as file:
                file.truncate(sum(map(_size, shapes.values())))
                handles = os.dup(file.fileno()), *os.pipe()
            os.set_blocking(handles[2], False)
        self.handles: tuple[int, ...] = handles
        self._shapes = dict(shapes)
        memory, begin = mmap.mmap(handles[0], 0), 0
        self._numbers: dict[str, NDArray[np.int64]] = {}  # of the frame in each place, from 1
        self._images: dict[str, Image] = {}
        for camera, shape in shapes.items():
            self._numbers[camera] = np.frombuffer(memory, np.int64, PLACES, begin)
            images = np.frombuffer(memory, np.uint8, PLACES * math.prod(shape), begin + 8 * PLACES)
            self._images[camera] = images.reshape(PLACES, *shape)
            begin += _size(shape)

    def __reduce__(self) -> tuple[Any, ...]:
        return SharedImages, (self._shapes, self.handles)

    def fits(self, camera: str, image: Image) -> bool:
        """Whether there is room for an image: it is of the camera's size."""
        return image.dtype == np.uint8 and image.shape == self._shapes[camera]

    def put(self, camera: str, number: int, image: Image) -> None:
        """Keep an image, and tell who waits for it."""
        self._images[camera][number % PLACES] = image
        self._numbers[camera][number % PLACES] = number + 1
        with suppress(BlockingIOError):  # nobody waits
            os.write(self.handles[2], b".")

    def copy(self, camera: str, number: int) -> Image:
        """An image for good; it is there, or will be."""
        place = number % PLACES
        while self._numbers[camera][place] != number + 1:
            poll = select.poll()
            poll.register(self.handles[1], select.POLLIN)
            if not poll.poll(1e3 * PATIENCE_S):
                raise DeviceFault(f"camera {camera}", f"no frame came for {PATIENCE_S:g} s")
            os.read(self.handles[1], 4096)
        image: Image = self._images[camera][place].copy()
        image.setflags(write=False)
        return image

    def close(self) -> None:
        """Let go of the memory; harmless when repeated."""
        for handle in self.handles:
            with suppress(OSError):
                os.close(handle)
        self.handles = ()


def pixel_shape(setup: CameraSetup) -> tuple[int, int, int]:
    """Of a camera's `Frame.pixels`."""
    return setup.height_px, setup.width_px, PIXEL_BYTES if setup.depth else 3


def _size(shape: tuple[int, int, int]) -> int:
    """Bytes of a camera's places, rounded up to whole numbers of frames."""
    return PLACES * (8 + -(-math.prod(shape) // 8) * 8)


class DetectorProcess(Worker[Look | Prepare, Seen | Done]):
    """A process that answers frames.

    Args:
        detect: makes the detectors there.
    """

    def __init__(
        self, name: str, detect: Callable[[], DetectByCamera], images: SharedImages, copied: bool = False
    ) -> None:
        work = partial(_detecting, detect, images)
        super().__init__(name, work, Look | Prepare, Seen | Done, images.handles, copied)

    def begin(self, frame: Frame, lies: int | None, limit_s: float = PATIENCE_S) -> Pending[Seen | Done]:
        """Begin to answer a frame, whose image lies in the shared memory or is sent along."""
        told = frame.camera, frame.sequence, frame.time_s, frame.world_from_camera, frame.robot_m
        return self.send(Look(*told, frame.pixels) if lies is None else Look(*told, lies=lies), limit_s)


def _detecting(detect: Callable[[], DetectByCamera], images: SharedImages) -> Callable[[Look | Prepare], Seen | Done]:
    """The work of the process."""
    detectors, prepared = detect(), dict[tuple[str, int], Image]()

    def look(job: Look) -> Seen:
        image = prepared.pop((job.camera, job.sequence), None) if job.image is None else job.image
        image = images.copy(job.camera, job.lies) if image is None else image
        (colours, depth_mm), told = apart(image), (job.camera, job.sequence, job.time_s)
        frame = Frame(*told, colours, job.world_from_camera, job.robot_m, depth_mm=depth_mm)
        return seen(detectors[job.camera](frame))

    def prepare(job: Prepare) -> Done:
        detector: object = detectors[job.camera]
        if isinstance(detector, Preparing):
            prepared.pop((job.camera, job.sequence - PLACES), None)  # nobody asked
            image = prepared[job.camera, job.sequence] = images.copy(job.camera, job.sequence)
            detector.prepare(apart(image)[0])
        return Done()

    return lambda job: look(job) if isinstance(job, Look) else prepare(job)
