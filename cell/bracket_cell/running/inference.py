"""Slow inference beside the tick: jobs go in, answers come out later, without waiting."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any, Generic, Protocol, TypeVar, cast

from bracket_cell.remote.detecting import PLACES, DetectByCamera, DetectorProcess, SharedImages
from bracket_cell.remote.worker import Pending
from bracket_cell.watching.observer import Observer
from bracket_ground.interfaces.clock import Clock
from bracket_ground.interfaces.devices import Devices
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import BenchView, PartsView

Job = TypeVar("Job")
Answer = TypeVar("Answer")
Job_contra = TypeVar("Job_contra", contravariant=True)
Answer_co = TypeVar("Answer_co", covariant=True)

BACKLOG = PLACES  # jobs that may wait for an answer; at 15 FPS half a second, later answers are of no use
SEND_S = 0.2  # in which a frame must be taken


class Executor(Protocol[Job_contra, Answer_co]):
    """Runs a detector; answers come in the order of their jobs."""

    def submit(self, job: Job_contra) -> bool:
        """Take a job; False when too many wait already and this one is dropped."""
        ...

    def poll(self) -> Answer_co | None:
        """The oldest answer not yet handed out, or None; never waits.

        Raises:
            DeviceFault: the detector has failed.
        """
        ...

    def close(self) -> None:
        """Let go of the detector; harmless when repeated."""
        ...


class FaultInjection(Observer):
    """Faults of a run on trial: proxies around devices and detectors; it observes when they are to come."""

    @property
    def told(self) -> str:
        """When each came, or that it never did."""
        raise NotImplementedError

    def devices(self, devices: Devices) -> Devices:
        """The same devices with the faults.

        Raises:
            InputError: these devices cannot have them.
        """
        raise NotImplementedError

    def detectors(
        self, watcher: Executor[Frame, BenchView], finder: Executor[Frame, PartsView]
    ) -> tuple[Executor[Frame, BenchView], Executor[Frame, PartsView]]:
        """The same detectors with the faults: of overhead and of wrist frames."""
        raise NotImplementedError


class DelayedExecutor(Generic[Job, Answer]):
    """Begins a job at once and hands its answer out when `latency_s` of clock time have passed, not before.

    So a simulated run is deterministic, and no tick knows an answer earlier than on a real cell.
    """

    def __init__(self, begin: Callable[[Job], Callable[[], Answer]], clock: Clock, latency_s: float) -> None:
        """An executor on a clock.

        Args:
            begin: starts a job; what it returns gives the answer, and waits where that is not ready.
        """
        self._begin = begin
        self._clock = clock
        self._latency_s = latency_s
        self._waiting: deque[tuple[float, Callable[[], Answer]]] = deque()

    def submit(self, job: Job) -> bool:
        if len(self._waiting) >= BACKLOG:
            return False
        self._waiting.append((self._clock.now_s() + self._latency_s, self._begin(job)))
        return True

    def poll(self) -> Answer | None:
        if self._waiting and self._waiting[0][0] <= self._clock.now_s() + 1e-9:
            return self._waiting.popleft()[1]()
        return None

    def close(self) -> None:
        self._waiting.clear()


class LockStep(DelayedExecutor[Job, Answer]):
    """Computes in `submit`, in this process."""

    def __init__(self, detector: Callable[[Job], Answer], clock: Clock, latency_s: float) -> None:
        def begin(job: Job) -> Callable[[], Answer]:
            answer = detector(job)
            return lambda: answer

        super().__init__(begin, clock, latency_s)


class DetectorExecutor(Generic[Answer_co]):
    """Runs a camera's detector in a process of its own (`--real-time`), so that it cannot hold up a tick.

    Attributes:
        process: in which it runs.

    Args:
        name: for faults.
        shape: of the camera's pixels, see `pixel_shape`; others are sent as they are, which takes longer.
        detect: makes the detector there.
        silent_s: so long it may take over what it does.
    """

    def __init__(
        self, name: str, camera: str, shape: tuple[int, int, int], detect: Callable[[], DetectByCamera], silent_s: float
    ) -> None:
        self._camera, self._silent_s = camera, silent_s
        self._images = SharedImages({camera: shape})
        self.process = DetectorProcess(name, detect, self._images)
        self._waiting: deque[Pending[Any]] = deque()
        self._number = 0

    def submit(self, job: Frame) -> bool:
        if len(self._waiting) >= BACKLOG:
            return False
        lies = None
        if self._images.fits(self._camera, pixels := job.pixels):
            lies = self._number = self._number + 1
            self._images.put(self._camera, lies, pixels)
        self._waiting.append(self.process.begin(job, lies, SEND_S))
        return True

    def poll(self) -> Answer_co | None:
        if self._waiting and self.process.arrived(self._waiting[0]):
            answer: Any = self._waiting.popleft().answer
            return cast("Answer_co", answer.view)
        self.process.glance(self._silent_s)
        return None

    def close(self) -> None:
        self.process.close()
        self._images.close()
