"""Frames and detectors beside the physics, in lock-step: one process draws, and another one detects in what it drew.

The controller needs an answer only some time after the frame, so all work at the same time. Images go through shared
memory: a slot is drawn into again only when everybody who reads it has done so.
"""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from functools import partial
from typing import Any, NamedTuple, TypeVar

import mujoco
import numpy as np
from numpy.typing import NDArray

from cell.errors import CellError, DeviceFault
from cell.interfaces.bench import CameraSetup
from cell.interfaces.perception import Frame, PendingFrame, Preparing
from sim.rendering.job_process import PATIENCE_S, JobProcess, process_context
from sim.rendering.photographer import Exposure, Photographer, SensorSetup

Answer = TypeVar("Answer")
Build = Callable[..., Callable[[Frame], Answer]]
Image = NDArray[np.uint8]

PREPARE = "prepare"  # what a job is that nobody waits for
NAME, DETECTORS = "render process", "detector process"
SLOTS = 8  # frames of a camera that may wait to be rendered; then the physics waits
HURRIED = 3  # ... where time does not wait
LESS_URGENT = 10  # niceness of drawing: the physics waits for answers that are due, and frames are due later


class _Drawn(NamedTuple):
    """The images as all processes share them.

    Attributes:
        slots: memory for SLOTS images of each camera.
        newest: number of the last frame of each camera that is drawn.
        told: released with every frame that is drawn.
    """

    setups: Mapping[str, CameraSetup]
    slots: Mapping[str, Any]
    newest: Mapping[str, Any]
    told: Any

    @classmethod
    def empty(cls, context: Any, setups: Mapping[str, CameraSetup]) -> _Drawn:
        """No frame is drawn."""
        slots = {name: context.RawArray(ctypes.c_uint8, SLOTS * _size(setup)) for name, setup in setups.items()}
        return cls(setups, slots, {name: context.RawValue("q", -1) for name in setups}, context.Semaphore(0))

    def image(self, camera: str, sequence: int) -> Image:
        """Where the image of a frame lies, (height, width, 3)."""
        setup = self.setups[camera]
        images = np.frombuffer(self.slots[camera], np.uint8).reshape(SLOTS, setup.height_px, setup.width_px, 3)
        image: Image = images[sequence % SLOTS]
        return image

    def copy(self, camera: str, sequence: int) -> Image:
        """The image of a frame, for good."""
        image = self.image(camera, sequence).copy()
        image.setflags(write=False)
        return image

    def put(self, frame: Frame) -> None:
        """Keep the image of a frame, and tell who waits for it."""
        self.image(frame.camera, frame.sequence)[:] = frame.image
        self.newest[frame.camera].value = frame.sequence
        self.told.release()

    def wait(self, camera: str, sequence: int) -> None:
        """Until a frame is drawn."""
        while self.newest[camera].value < sequence:
            if not self.told.acquire(timeout=PATIENCE_S):
                raise DeviceFault(NAME, f"no frame came for {PATIENCE_S:g} s")


class RenderProcess:
    """Makes frames and answers in processes of its own; close it.

    Attributes:
        hurried: time does not wait: frames are left out where it cannot keep up.
    """

    def __init__(self, model: mujoco.MjModel, sensors: Mapping[str, SensorSetup]) -> None:
        """Start them; returns before they are ready.

        Args:
            model: the compiled cell.
            sensors: by the camera's name.
        """
        context = process_context()
        self._drawn = _Drawn.empty(context, {camera: sensor.setup for camera, sensor in sensors.items()})
        self.hurried = False
        self._taken: dict[tuple[str, int], tuple[int, Future[Any]]] = {}  # number of the frame by camera and slot
        self._read: dict[tuple[str, int], Future[Any]] = {}  # the last answer from the image there
        self._detectors = 0
        self._asked: dict[str, int] = {}  # detector that was asked about a camera's last frame
        self._ahead: list[tuple[str, int]] = []  # frames that nobody has asked about yet
        drawn, given = self._drawn, (model, dict(sensors))
        self._drawing = JobProcess(context, NAME, _draw, (drawn,), given, lambda frame: drawn.copy(*frame))
        self._detecting = JobProcess(context, DETECTORS, _detect, (drawn,), beside=(self._drawing,))
        self._drawing.listen()  # several wait for frames; the controller alone waits for answers, and reads them itself

    @property
    def process_ids(self) -> tuple[int, int]:
        """Of the process that draws, and of the one that detects."""
        return self._drawing.process_id, self._detecting.process_id

    def take(self, exposure: Exposure) -> PendingFrame | None:
        """A frame whose image comes later. Raises DeviceFault.

        Where very many are under way it waits, or is left out where time does not wait.
        """
        camera, sequence = exposure.camera, exposure.sequence
        slot = (camera, sequence % SLOTS)
        if self.hurried and sum(not one.done() for _, one in self._taken.values()) >= HURRIED:
            return None
        if slot in self._taken:  # until then its image lies where this one will
            self._drawing.awaited(self._taken[slot][1])
        if slot in self._read:
            self._detecting.awaited(self._read.pop(slot))
        future = self._drawing.send(exposure)
        self._taken[slot] = sequence, future
        self._ahead.append((camera, sequence))
        image = partial(self._drawing.awaited, future)
        return PendingFrame(camera, sequence, exposure.time_s, image, exposure.world_from_camera, future.done)

    def host(self, build: Build[Answer], *arguments: object) -> Callable[[Frame], Callable[[], Answer]]:
        """Run a detector there; see `DetectorHost`. Raises DeviceFault, for the process that draws, too."""
        self._detecting.awaited(self._detecting.send((build, arguments)))
        self._drawing.check()  # else one that died as it began is only missed when its frames are
        self._detectors += 1
        return partial(self._begin, self._detectors - 1)

    def close(self) -> None:
        """End the processes; harmless when repeated."""
        self._drawing.close()
        self._detecting.close()

    def _begin(self, detector: int, frame: Frame) -> Callable[[], Any]:
        """Send a frame of ours to a detector; the answer is waited for by who calls the result."""
        slot = (frame.camera, frame.sequence % SLOTS)
        known = slot in self._taken and self._taken[slot][0] == frame.sequence
        lies = known and isinstance(frame, PendingFrame)  # else somebody has put another image in its place
        told = frame.camera, frame.sequence, frame.time_s, frame.world_from_camera, frame.robot_m
        future = self._detecting.send((detector, told, None if lies else frame.image))
        if lies:
            self._read[slot] = future
        self._asked[frame.camera] = detector
        self._ahead = [one for one in self._ahead if one[0] != frame.camera or one[1] > frame.sequence]
        self._prepare()

        def answer() -> Any:
            found = self._detecting.awaited(future, needs=self._drawing)
            self._prepare()
            return found

        return answer

    def _prepare(self) -> None:
        """Let detectors begin with the frames that they will be asked about next, once nothing else waits for them."""
        for camera, sequence in self._ahead:
            if camera in self._asked:
                job = self._detecting.send((PREPARE, self._asked[camera], camera, sequence))
                self._read[camera, sequence % SLOTS] = job
        self._ahead.clear()


def _draw(
    drawn: _Drawn, model: mujoco.MjModel, sensors: Mapping[str, SensorSetup]
) -> Callable[[Exposure], tuple[str, int]]:
    """The work of the process that draws: makes the frame of an exposure, and tells which one is drawn."""
    os.nice(LESS_URGENT)
    photographer = Photographer(model, sensors)

    def draw(exposure: Exposure) -> tuple[str, int]:
        drawn.put(photographer.take(exposure))
        return exposure.camera, exposure.sequence

    return draw


def _detect(drawn: _Drawn) -> Callable[[tuple[Any, ...]], Any]:
    """The work of the process that detects: builds a detector, or asks one that was built, by its number."""
    detectors: list[Callable[[Frame], object]] = []
    beginning: list[Callable[[Image], None] | None] = []
    prepared: dict[tuple[str, int], Image] = {}

    def build(what: Build[object], arguments: tuple[object, ...]) -> CellError | None:
        try:
            made = what(*arguments)
        except CellError as error:  # the user's file is wrong: told as it is
            return error
        detectors.append(made)
        beginning.append(made.prepare if isinstance(made, Preparing) else None)
        return None

    def answer(detector: int, told: tuple[Any, ...], image: Image | None) -> object:
        camera, sequence, time_s, world_from_camera, robot_m = told
        if image is None:
            image = prepared.pop((camera, sequence), None)
        if image is None:
            image = look(camera, sequence)
        return detectors[detector](Frame(camera, sequence, time_s, image, world_from_camera, robot_m))

    def look(camera: str, sequence: int) -> Image:
        drawn.wait(camera, sequence)
        return drawn.copy(camera, sequence)

    def prepare(detector: int, camera: str, sequence: int) -> None:
        if (begin := beginning[detector]) is not None:
            prepared.pop((camera, sequence - SLOTS), None)  # nobody asked
            prepared[camera, sequence] = look(camera, sequence)
            begin(prepared[camera, sequence])

    def work(job: tuple[Any, ...]) -> object:
        if job[0] == PREPARE:
            prepare(*job[1:])
            return None
        return build(*job) if callable(job[0]) else answer(*job)

    return work


def _size(setup: CameraSetup) -> int:
    return setup.width_px * setup.height_px * 3
