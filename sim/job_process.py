"""A process beside the simulation that works off jobs in the order in which they were sent (decision 6).

Nobody looks whether a job is done: who needs what it comes to waits. So a run is the same as in one process.
"""

from __future__ import annotations

import gc
import itertools
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any

import cv2

from cell.interfaces.errors import CellError, DeviceFault

JOIN_S = 2.0
PATIENCE_S = 60.0  # wall time; a job takes some milliseconds

Work = Callable[[Any], Any]


def process_context() -> Any:
    """How processes begin: as copies of this one where that is safe, which saves them all imports.

    A copy has no threads but one, and graphics that have been used do not live on in it.
    """
    return multiprocessing.get_context("fork" if _may_fork() else "spawn")


class JobProcess:
    """One process; close it. What goes wrong in it is a DeviceFault for everybody who waits for it.

    Attributes:
        pipe: our end of the pipe to it, which a copy of this process must close.
    """

    def __init__(
        self,
        context: Any,
        name: str,
        make: Callable[..., Work],
        given: Sequence[object],
        arrived: Callable[[Any], Any] = lambda result: result,
        beside: Sequence[JobProcess] = (),
    ) -> None:
        """Start it; returns before it is ready. `listen` is called once all processes have been started, if at all.

        Args:
            context: see `process_context`.
            name: for faults.
            make: called in it with `given`; what it returns works off a job. A CellError that a job comes to as its
                result is raised where it is waited for.
            arrived: called here with each result before it is handed out.
            beside: processes that were started before.
        """
        self._name, self._arrived = name, arrived
        self._pending: dict[int, Future[Any]] = {}
        self._numbers = itertools.count()
        self._lock = threading.Lock()
        self._fault: DeviceFault | None = None
        self.pipe, theirs = context.Pipe()
        ours = [self.pipe, *(one.pipe for one in beside)]
        self._process: BaseProcess = context.Process(
            target=_serve, args=(theirs, ours, make, given), name=name, daemon=True
        )
        with _one_cv2_thread():
            self._process.start()
        theirs.close()
        self._receiver = threading.Thread(target=self._receive, name=name, daemon=True)

    @property
    def process_id(self) -> int:
        """Of the running process."""
        assert self._process.pid is not None
        return self._process.pid

    def listen(self) -> None:
        """Begin to hand out what comes back, in a thread; without it one thread alone may wait for answers."""
        self._receiver.start()

    def send(self, job: object) -> Future[Any]:
        """Begin a job; raises DeviceFault where the process has failed."""
        future: Future[Any] = Future()
        with self._lock:
            if self._fault is not None:
                raise self._fault
            number = next(self._numbers)
            self._pending[number] = future
        with suppress(OSError):  # a process that died fails everything that is pending
            self.pipe.send((number, job))
        return future

    def awaited(self, future: Future[Any]) -> Any:
        """What a job came to; waits for it. Raises DeviceFault, and what the job says of the user's files.

        Where nobody listens, who waits reads.
        """
        while self._receiver.ident is None and not future.done():
            if not self.pipe.poll(PATIENCE_S):
                raise DeviceFault(self._name, f"nothing came for {PATIENCE_S:g} s")
            if reason := self._read():
                self._fail(reason)
        try:
            return future.result(PATIENCE_S)
        except TimeoutError:
            raise DeviceFault(self._name, f"nothing came for {PATIENCE_S:g} s") from None

    def close(self) -> None:
        """End the process; harmless when repeated."""
        if self._process.is_alive():
            self._process.kill()
        self._process.join(JOIN_S)
        if self._receiver.is_alive():
            self._receiver.join(JOIN_S)
        self.pipe.close()

    def _receive(self) -> None:
        """Hand out what comes back, until the process ends; runs in a thread."""
        while not (reason := self._read()):
            pass
        self._fail(reason)

    def _read(self) -> str:
        """Hand out the next that comes back; waits for it. Returns why nothing more will come."""
        try:
            number, result = self.pipe.recv()
        except (EOFError, OSError):
            self._process.join(JOIN_S)
            return f"it died (exit code {self._process.exitcode})"
        if number is None:
            return str(result)
        self._hand_out(number, result)
        return ""

    def _fail(self, reason: str) -> None:
        """Tell everybody who waits, and who will ask."""
        with self._lock:
            self._fault = DeviceFault(self._name, reason)
            pending, self._pending = self._pending, {}
        for future in pending.values():
            future.set_exception(self._fault)

    def _hand_out(self, number: int, result: Any) -> None:
        with self._lock:
            future = self._pending.pop(number)
        if isinstance(result, CellError):
            future.set_exception(result)
        else:
            future.set_result(self._arrived(result))


def _may_fork() -> bool:
    """Whether a process can begin as a copy of this one: it has one thread, and has not used graphics."""
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


def _leave_a_core() -> None:
    """Where there are two cores, one is the controller's alone: where all share both, everyone waits for everyone."""
    if sys.platform == "linux" and len(usable := os.sched_getaffinity(0)) == 2:
        os.sched_setaffinity(0, {max(usable)})


def _serve(pipe: Connection, theirs: Sequence[Connection], make: Callable[..., Work], given: Sequence[object]) -> None:
    """The process: works off jobs in their order; one that fails ends it, and the controller is told why."""
    for other in theirs:  # else the controller's death would not end the pipes
        other.close()
    # Signals often go to all processes of a group: this one lives until the controller has stopped the arm.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    # The other cores have work of their own: no threads for images or, where MuJoCo renders in software, for triangles.
    cv2.setNumThreads(1)
    os.environ.setdefault("LP_NUM_THREADS", "0")
    gc.freeze()  # what came with the copy stays shared
    _leave_a_core()
    try:
        work = make(*given)
        while True:
            number, job = pipe.recv()
            pipe.send((number, work(job)))
    except (EOFError, OSError):
        return  # the controller is gone
    except BaseException as error:
        with suppress(OSError):
            pipe.send((None, f"{type(error).__name__}: {error}"))
