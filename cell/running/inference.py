"""Slow inference beside the tick: jobs go in, answers come out later, without waiting."""

from __future__ import annotations

import multiprocessing
import queue
import signal
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from multiprocessing.queues import Queue
from multiprocessing.synchronize import Event
from typing import Generic, Protocol, TypeVar

from cell.errors import DeviceFault
from cell.interfaces.clock import Clock

Job = TypeVar("Job")
Answer = TypeVar("Answer")
Job_contra = TypeVar("Job_contra", contravariant=True)
Answer_co = TypeVar("Answer_co", covariant=True)

BACKLOG = 8  # jobs that may wait for an answer; at 15 FPS half a second, later answers are of no use
JOIN_S = 2.0
PARENT_CHECK_S = 1.0


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


class WorkerProcess(Generic[Job, Answer]):
    """Runs the detector in a process of its own (`--real-time`), so that it cannot hold up a tick."""

    def __init__(self, name: str, build: Callable[..., Callable[[Job], Answer]], *arguments: object) -> None:
        """Start the process.

        Args:
            name: for faults.
            build: makes the detector inside the process; a module's function, as it is sent there by name.
            arguments: for `build`; must be picklable.
        """
        self._name = name
        context = multiprocessing.get_context("spawn")
        self._jobs: Queue[Job] = context.Queue()
        self._answers: Queue[tuple[Answer | None, str]] = context.Queue()
        self._waiting = 0
        self._ready = context.Event()
        self._process = context.Process(
            target=_work, args=(build, arguments, self._jobs, self._answers, self._ready), name=name, daemon=True
        )
        self._process.start()

    def await_ready(self) -> None:
        """Wait until the detector is there; `poll` reports one that fails."""
        while self._process.is_alive() and not self._ready.wait(PARENT_CHECK_S):
            pass

    @property
    def process_id(self) -> int:
        """Of the running process."""
        assert self._process.pid is not None
        return self._process.pid

    def submit(self, job: Job) -> bool:
        if self._waiting >= BACKLOG:
            return False
        self._waiting += 1
        self._jobs.put(job)
        return True

    def poll(self) -> Answer | None:
        alive = self._process.is_alive()  # read before the queue: what a worker left behind still counts
        try:
            answer, failure = self._answers.get_nowait()
        except queue.Empty:
            if not alive:
                raise DeviceFault(self._name, f"its process died (exit code {self._process.exitcode})") from None
            return None
        if failure:
            raise DeviceFault(self._name, failure)
        self._waiting -= 1
        return answer

    def close(self) -> None:
        self._jobs.cancel_join_thread()
        if self._process.is_alive():
            self._process.kill()
            self._process.join(JOIN_S)
        self._jobs.close()
        self._answers.close()


def _work(
    build: Callable[..., Callable[[Job], Answer]],
    arguments: tuple[object, ...],
    jobs: Queue[Job],
    answers: Queue[tuple[Answer | None, str]],
    ready: Event,
) -> None:
    # Signals often go to all processes of a group: this one lives until the controller has stopped the arm.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    try:
        detector = build(*arguments)
        ready.set()
        for job in _jobs(jobs):
            answers.put((detector(job), ""))
    except Exception as error:  # outermost loop of the process: the controller turns it into a fault
        answers.put((None, f"{type(error).__name__}: {error}"))


def _jobs(jobs: Queue[Job]) -> Iterator[Job]:
    """Jobs as long as the controller lives, even if it was killed."""
    parent = multiprocessing.parent_process()
    while parent is None or parent.is_alive():
        with suppress(queue.Empty):
            yield jobs.get(timeout=PARENT_CHECK_S)
