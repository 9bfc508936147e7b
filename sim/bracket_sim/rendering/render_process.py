"""Frames and detectors beside the physics: one process draws, and another one detects in what it drew.

The controller needs an answer only some time after the frame, so all work at the same time. In lock-step nobody looks
whether a job is done: who needs what it comes to waits. So a run is the same as in one process.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import mujoco

from bracket_cell.remote.channel import Message
from bracket_cell.remote.child import may_copy
from bracket_cell.remote.detecting import (
    PLACES,
    Bench,
    DetectByCamera,
    DetectorProcess,
    Done,
    Image,
    Prepare,
    SharedImages,
    Tray,
    pixel_shape,
)
from bracket_cell.remote.worker import Pending, Worker, await_ready
from bracket_ground.interfaces.frame import Frame, PendingFrame
from bracket_ground.interfaces.perception import BenchView, PartsView
from bracket_sim.rendering.photographer import Exposure, Photographer, SensorSetup

DRAWING, DETECTING = "renderer", "detector"
HURRIED = 3  # frames that may wait to be drawn where time does not wait
SILENT_S = 0.5  # after which a renderer is told of that draws nothing
LESS_URGENT = 10  # niceness of drawing: the physics waits for answers that are due, and frames are due later


class Draw(Message, frozen=True):
    """Make a frame."""

    exposure: Exposure


class Drawn(Message, frozen=True):
    """A frame's image lies in the shared memory.

    Attributes:
        image: of its own, once it has come.
    """

    camera: str
    sequence: int
    image: Image | None = None


class RenderProcess:
    """Makes frames, and answers if there are detectors, in processes of its own; close it.

    Attributes:
        hurried: time does not wait: frames are left out where it cannot keep up.

    Args:
        model: the compiled cell.
        sensors: by the camera's name.
        detect: makes the detectors.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        sensors: Mapping[str, SensorSetup],
        detect: Callable[[], DetectByCamera] | None = None,
    ) -> None:
        copied = may_copy()
        shapes = {camera: pixel_shape(sensor.setup) for camera, sensor in sensors.items()}
        self._images = images = SharedImages(shapes)
        self.hurried = False
        self._taken: dict[tuple[str, int], tuple[int, Pending[Drawn]]] = {}  # number of the frame by camera and place
        self._read: dict[tuple[str, int], Pending[Any]] = {}  # the last answer from the image there
        self._asked: set[str] = set()  # cameras whose frames are asked about
        self._ahead: list[tuple[str, int]] = []  # frames that nobody has asked about yet
        self._drawing: Worker[Draw, Drawn] = Worker(
            DRAWING, partial(_drawing, images, model, dict(sensors)), Draw, Drawn, images.handles, copied, self._came
        )
        self._detecting = None if detect is None else DetectorProcess(DETECTING, detect, images, copied)

    @property
    def process_ids(self) -> tuple[int, ...]:
        """Of the process that draws, and of the one that detects."""
        return tuple(worker.child.process_id for worker in (self._drawing, self._detecting) if worker is not None)

    @property
    def detects(self) -> bool:
        """Whether it has detectors."""
        return self._detecting is not None

    def await_ready(self) -> None:
        """Until it has drawn what it was given, and the detectors are made; raises CellError."""
        await_ready(*[worker for worker in (self._drawing, self._detecting) if worker is not None])

    def take(self, exposure: Exposure) -> PendingFrame | None:
        """A frame whose image comes later. Raises DeviceFault.

        Where very many are under way it waits, or is left out where time does not wait.
        """
        camera, sequence = exposure.camera, exposure.sequence
        place = camera, sequence % PLACES
        if self.hurried:
            self._drawing.glance(SILENT_S)
            if self._drawing.waiting >= HURRIED:
                return None
        if place in self._taken:  # until then its image lies where this one will
            self._drawing.awaited(self._taken[place][1])
        if place in self._read and self._detecting is not None:
            self._detecting.awaited(self._read.pop(place))
        pending = self._drawing.send(Draw(exposure))
        self._taken[place] = sequence, pending
        self._ahead.append((camera, sequence))

        def image() -> Image:
            found = self._drawing.awaited(pending).image
            assert found is not None
            return found

        done = partial(self._drawing.arrived, pending)
        return PendingFrame(camera, sequence, exposure.time_s, image, exposure.world_from_camera, done)

    def begin(self, frame: Frame) -> Callable[[], BenchView | PartsView]:
        """Send a frame to its detector; see `DetectorHost`. Raises DeviceFault."""
        assert self._detecting is not None
        detecting, place = self._detecting, (frame.camera, frame.sequence % PLACES)
        known = place in self._taken and self._taken[place][0] == frame.sequence
        lies = known and isinstance(frame, PendingFrame)  # else somebody has put another image in its place
        self._drawing.check()  # else one that died as it began is only missed when its frames are
        pending = detecting.begin(frame, frame.sequence if lies else None)
        if lies:
            self._read[place] = pending
        self._asked.add(frame.camera)
        self._ahead = [image for image in self._ahead if image[0] != frame.camera or image[1] > frame.sequence]
        self._prepare(detecting)

        def answer() -> BenchView | PartsView:
            found = detecting.awaited(pending, needs=self._drawing)
            self._prepare(detecting)
            assert isinstance(found, Bench | Tray)
            return found.view

        return answer

    def close(self) -> None:
        """End the processes; harmless when repeated."""
        self._drawing.close()
        if self._detecting is not None:
            self._detecting.close()
        self._images.close()

    def _came(self, drawn: Drawn) -> Drawn:
        return Drawn(drawn.camera, drawn.sequence, self._images.copy(drawn.camera, drawn.sequence))

    def _prepare(self, detecting: Worker[Any, Done | Bench | Tray]) -> None:
        """Let detectors begin with the frames that they will be asked about next, once nothing else waits for them."""
        for camera, sequence in self._ahead:
            if camera in self._asked:
                self._read[camera, sequence % PLACES] = detecting.send(Prepare(camera, sequence))
        self._ahead.clear()


def _drawing(
    images: SharedImages, model: mujoco.MjModel, sensors: Mapping[str, SensorSetup]
) -> Callable[[Draw], Drawn]:
    """The work of the process that draws: makes the frame of an exposure, and tells which one is drawn."""
    os.nice(LESS_URGENT)
    photographer = Photographer(model, sensors)

    def draw(job: Draw) -> Drawn:
        frame = photographer.take(job.exposure)
        images.put(frame.camera, frame.sequence, frame.pixels)
        return Drawn(frame.camera, frame.sequence)

    return draw
