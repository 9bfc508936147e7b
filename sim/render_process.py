"""A process beside the physics: it makes the frames, and runs the detectors that read them, in lock-step (decision 6).

The controller needs an answer only some time after the frame, so both processes work at the same time. What comes out
is the same as in one process: exposures are worked off in the order in which they were sent, frames for detectors in
theirs, and nobody looks whether something is ready; who needs it waits.
"""

from __future__ import annotations

import ctypes
import itertools
import multiprocessing
import os
import signal
import sys
import threading
from collections import deque
from collections.abc import Callable, Hashable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from functools import partial
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any, TypeVar

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray

from cell.interfaces.bench import CameraSetup
from cell.interfaces.errors import CellError, DeviceFault
from cell.interfaces.perception import Frame, PendingFrame
from sim.photographer import Exposure, Photographer, SensorSetup

Answer = TypeVar("Answer")
Build = Callable[..., Callable[[Frame], Answer]]
Slots = Mapping[str, Any]  # shared memory for SLOTS images of each camera

NAME = "render process"
SLOTS = 8  # frames of a camera that may wait to be rendered; then the physics waits
JOIN_S = 2.0
SWITCH_S = 0.0005  # a thread that is done with graphics soon gets its turn
HURRIED = 3  # ... where time does not wait
PATIENCE_S = 60.0  # wall time; a frame takes some milliseconds


class RenderProcess:
    """Makes frames and answers in a process of its own; close it.

    Attributes:
        hurried: time does not wait: frames are left out where it cannot keep up.
    """

    def __init__(self, model: mujoco.MjModel, sensors: Mapping[str, SensorSetup]) -> None:
        """Start it; returns before it is ready.

        Args:
            model: the compiled cell.
            sensors: by the camera's name.
        """
        context: Any = multiprocessing.get_context("fork" if _may_fork() else "spawn")
        self._setups = {camera: sensor.setup for camera, sensor in sensors.items()}
        self._slots = {
            camera: context.RawArray(ctypes.c_uint8, SLOTS * _size(setup)) for camera, setup in self._setups.items()
        }
        self._pending: dict[Hashable, Future[Any]] = {}
        self._lock = threading.Lock()
        self._fault: DeviceFault | None = None
        self._numbers = itertools.count()
        self.hurried = False
        self._taken: dict[tuple[str, int], Future[Any]] = {}  # by camera and slot
        self._pipe, theirs = context.Pipe()
        given = theirs, self._pipe, model, dict(sensors), self._slots
        self._process: BaseProcess = context.Process(target=_serve, args=given, name=NAME, daemon=True)
        with _one_cv2_thread():
            self._process.start()
        theirs.close()
        self._receiver = threading.Thread(target=self._receive, name=NAME, daemon=True)
        self._receiver.start()

    @property
    def process_id(self) -> int:
        """Of the running process."""
        assert self._process.pid is not None
        return self._process.pid

    def take(self, exposure: Exposure) -> PendingFrame | None:
        """A frame whose image comes later. Raises DeviceFault.

        Where very many are under way it waits, or is left out where time does not wait.
        """
        camera, sequence = exposure.camera, exposure.sequence
        slot = (camera, sequence % SLOTS)
        if self.hurried and sum(not one.done() for one in self._taken.values()) >= HURRIED:
            return None
        if (earlier := self._taken.get(slot)) is not None:
            _awaited(earlier)  # until then its image lies where this one will
        future = self._taken[slot] = self._send(("frame", camera, sequence), exposure)
        pose, image = exposure.world_from_camera, partial(_awaited, future)
        return PendingFrame(camera, sequence, exposure.time_s, image, pose, future.done)

    def host(self, build: Build[Answer], *arguments: object) -> Callable[[Frame], Callable[[], Answer]]:
        """Run a detector there; see `DetectorHost`."""
        number = next(self._numbers)
        _awaited(self._send(("built", number), (build, arguments)))
        return partial(self._begin, number)

    def close(self) -> None:
        """End the process; harmless when repeated."""
        if self._process.is_alive():
            self._process.kill()
        self._process.join(JOIN_S)
        self._receiver.join(JOIN_S)
        self._pipe.close()

    def _begin(self, detector: int, frame: Frame) -> Callable[[], Any]:
        """Send a frame of ours to a detector; the answer is waited for by who calls the result."""
        job = detector, frame.camera, frame.sequence, frame.robot_m
        return partial(_awaited, self._send(("answer", next(self._numbers)), job))

    def _send(self, key: tuple[object, ...], job: object) -> Future[Any]:
        future: Future[Any] = Future()
        with self._lock:
            if self._fault is not None:
                raise self._fault
            self._pending[key] = future
        with suppress(OSError):  # a process that died fails everything that is pending
            self._pipe.send((key, job))
        return future

    def _receive(self) -> None:
        """Hand out what comes back, until the process ends; runs in a thread."""
        reason = ""
        try:
            while True:
                key, result = self._pipe.recv()
                if key is None:
                    reason = result
                    break
                self._hand_out(key, result)
        except (EOFError, OSError):
            self._process.join(JOIN_S)
            reason = f"it died (exit code {self._process.exitcode})"
        with self._lock:
            self._fault = DeviceFault(NAME, reason)
            pending, self._pending = self._pending, {}
        for future in pending.values():
            future.set_exception(self._fault)

    def _hand_out(self, key: tuple[Any, ...], result: Any) -> None:
        with self._lock:
            future = self._pending.pop(key)
        if isinstance(result, CellError):
            future.set_exception(result)
        elif key[0] == "frame":
            _, camera, sequence = key
            future.set_result(_fixed(_slot(self._slots, self._setups[camera], camera, sequence).copy()))
        else:
            future.set_result(result)


def _may_fork() -> bool:
    """Whether the process can begin as a copy of this one, which saves it all imports.

    A copy has no threads but one, and graphics that have been used do not live on in it.
    """
    egl = sys.modules.get("mujoco.egl")
    unused = egl is not None and egl.EGL_DISPLAY is None
    return sys.platform == "linux" and unused and threading.active_count() == 1


@contextmanager
def _one_cv2_thread() -> Iterator[None]:
    """A copy of this process would wait for OpenCV's threads, which it has not got."""
    count = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(count)


def _serve(
    pipe: Connection, theirs: Connection, model: mujoco.MjModel, sensors: Mapping[str, SensorSetup], slots: Slots
) -> None:
    """The process: works off exposures, detectors to build and frames to look at, in their order."""
    theirs.close()  # else the controller's death would not end the pipe
    # Signals often go to all processes of a group: this one lives until the controller has stopped the arm.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    # The other core has work of its own: no threads for images or, where MuJoCo renders in software, for triangles.
    cv2.setNumThreads(1)
    os.environ.setdefault("LP_NUM_THREADS", "0")
    sys.setswitchinterval(SWITCH_S)
    worker = _Worker(model, sensors, slots)
    lock = threading.Lock()
    try:
        while True:
            key, job = pipe.recv()
            worker.begin(key, job).add_done_callback(partial(_tell, pipe, lock, key))
    except (EOFError, OSError):
        return  # the controller is gone
    finally:
        worker.close()


def _tell(pipe: Connection, lock: threading.Lock, key: tuple[Any, ...], done: Future[Any]) -> None:
    """Send what a job came to; one that failed ends everything: the controller turns it into a fault."""
    if done.cancelled():
        return
    error = done.exception()
    told = (key, done.result()) if error is None else (None, f"{type(error).__name__}: {error}")
    with lock, suppress(OSError):
        pipe.send(told)


class _Worker:
    """What the process knows; one thread draws and another one detects, each in the order in which it was asked."""

    def __init__(self, model: mujoco.MjModel, sensors: Mapping[str, SensorSetup], slots: Slots) -> None:
        self._drawing, self._detecting = ThreadPoolExecutor(1), ThreadPoolExecutor(1)
        self._photographer = self._drawing.submit(Photographer, model, sensors)  # graphics belong to their thread
        self._sensors, self._slots = sensors, slots
        self._frames = {camera: deque[tuple[int, Future[Frame]]](maxlen=SLOTS) for camera in sensors}
        self._detectors: dict[int, Callable[[Frame], object]] = {}

    def begin(self, key: tuple[Any, ...], job: Any) -> Future[Any]:
        """Begin a job; what it comes to is sent back for it."""
        if key[0] == "frame":
            frame: Future[Frame] = Future()
            self._frames[job.camera].append((job.sequence, frame))
            return self._drawing.submit(self._take, job, frame)
        if key[0] == "built":
            return self._detecting.submit(self._build, key[1], *job)
        detector, camera, sequence, robot_m = job
        asked = next(frame for number, frame in self._frames[camera] if number == sequence)
        return self._detecting.submit(lambda: self._detectors[detector](asked.result().beside(robot_m)))

    def close(self) -> None:
        """Begin nothing any more."""
        for thread in (self._drawing, self._detecting):
            thread.shutdown(wait=False, cancel_futures=True)

    def _take(self, exposure: Exposure, taken: Future[Frame]) -> None:
        try:
            frame = self._photographer.result().take(exposure)
        except BaseException as error:
            taken.set_exception(error)
            raise
        _slot(self._slots, self._sensors[frame.camera].setup, frame.camera, frame.sequence)[:] = frame.image
        taken.set_result(frame)

    def _build(self, number: int, build: Build[object], arguments: tuple[object, ...]) -> CellError | None:
        try:
            self._detectors[number] = build(*arguments)
        except CellError as error:  # the user's file is wrong: told as it is
            return error
        return None


def _awaited(future: Future[Any]) -> Any:
    try:
        return future.result(PATIENCE_S)
    except TimeoutError:
        raise DeviceFault(NAME, f"nothing came for {PATIENCE_S:g} s") from None


def _size(setup: CameraSetup) -> int:
    return setup.width_px * setup.height_px * 3


def _slot(slots: Slots, setup: CameraSetup, camera: str, sequence: int) -> NDArray[np.uint8]:
    """Where the image of a frame lies in shared memory."""
    images = np.frombuffer(slots[camera], np.uint8).reshape(SLOTS, setup.height_px, setup.width_px, 3)
    image: NDArray[np.uint8] = images[sequence % SLOTS]
    return image


def _fixed(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    image.setflags(write=False)
    return image
