"""A process beside the simulation that works off jobs in the order in which they were sent (decision 6).

Nobody looks whether a job is done: who needs what it comes to waits. So a run is the same as in one process.
"""

from __future__ import annotations

import gc
import itertools
import multiprocessing
import os
import select
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

from cell.errors import CellError, DeviceFault

GLANCE_S = 0.5  # wall time between looks at other processes
JOIN_S = 2.0
PATIENCE_S = 60.0  # wall time; a job takes some milliseconds
Work = Callable[[Any], Any]


def two_cores() -> tuple[int, int] | None:
    """The controller's core and that of all others; None where there are not just two."""
    if sys.platform != "linux":
        return None
    usable = os.sched_getaffinity(0)
    return (min(usable), max(usable)) if len(usable) == 2 else None


def leave_controllers_core(cores: tuple[int, int] | None) -> None:
    """This process works on the other core from now on."""
    if cores is not None:
        os.sched_setaffinity(0, {cores[1]})


@contextmanager
def lent(process_id: int, cores: tuple[int, int] | None) -> Iterator[None]:
    """A process that left the controller's core has it for itself meanwhile."""
    if cores is None:
        yield
        return
    with suppress(OSError):  # it died: who waits for it is told elsewhere
        os.sched_setaffinity(process_id, {cores[0]})
    try:
        yield
    finally:
        with suppress(OSError):
            os.sched_setaffinity(process_id, {cores[1]})


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
        shared: Sequence[object],
        given: Sequence[object] = (),
        arrived: Callable[[Any], Any] = lambda result: result,
        beside: Sequence[JobProcess] = (),
    ) -> None:
        """Start it; returns before it is ready. `listen` is called once all processes have been started, if at all.

        Args:
            context: see `process_context`.
            name: for faults.
            make: called in it with `shared` and `given`; what it returns works off a job. A CellError that a job comes
                to as its result is raised where it is waited for.
            shared: memory and locks of all processes, which can only be handed over as the process begins; few bytes.
            given: of any size, through our own pipe: Python's own way to begin a process waits for ever where it dies
                before it has read all.
            arrived: called here with each result before it is handed out.
            beside: processes that were started before.
        """
        self._name, self._arrived = name, arrived
        self._pending: dict[int, Future[Any]] = {}
        self._numbers = itertools.count()
        self._lock = threading.Lock()
        self._fault: DeviceFault | None = None
        self._cores = two_cores()
        self.pipe, theirs = context.Pipe()
        self._arrivals = select.poll()  # the pipe's own way to ask makes such a one each time
        self._arrivals.register(self.pipe.fileno(), select.POLLIN)
        ours = [self.pipe, *(one.pipe for one in beside)]
        self._process: BaseProcess = context.Process(
            target=_serve, args=(theirs, ours, self._cores, make, shared), name=name, daemon=True
        )
        # The other cores have work of their own, and a copy would wait for OpenCV's threads, which it has not got.
        cv2.setNumThreads(1)
        self._process.start()
        theirs.close()
        self._give(tuple(given))
        self._receiver = threading.Thread(target=self._receive, name=name, daemon=True)

    @property
    def process_id(self) -> int:
        """Of the running process."""
        assert self._process.pid is not None
        return self._process.pid

    def listen(self) -> None:
        """Begin to hand out what comes back, in a thread; without it one thread alone may wait for answers."""
        self._receiver.start()

    def check(self) -> None:
        """Raise DeviceFault where the process is known to have failed."""
        if self._fault is not None:
            raise self._fault

    def send(self, job: object) -> Future[Any]:
        """Begin a job; raises DeviceFault where the process has failed."""
        future: Future[Any] = Future()
        with self._lock:
            self.check()
            number = next(self._numbers)
            self._pending[number] = future
        self._give((number, job))
        return future

    def _give(self, something: object) -> None:
        with suppress(OSError):  # a process that died fails everything that is pending
            self.pipe.send(something)

    def awaited(self, future: Future[Any], needs: JobProcess | None = None) -> Any:
        """What a job came to; waits for it. Raises DeviceFault, and what the job says of the user's files.

        Where nobody listens, who waits reads.

        Args:
            needs: a process that this one waits for: it has the controller's core meanwhile, and its fault is raised.
        """
        if self._receiver.ident is None:
            if needs is None or future.done() or self._arrivals.poll(0):
                self._read_until(future, needs)
            else:
                with lent(needs.process_id, self._cores):
                    self._read_until(future, needs)
        try:
            return future.result(PATIENCE_S)
        except TimeoutError:
            raise self._silent from None

    def _read_until(self, future: Future[Any], needs: JobProcess | None) -> None:
        waited_s = 0.0
        while not future.done():
            if self._arrivals.poll(1e3 * GLANCE_S):
                if reason := self._read():
                    self._fail(reason)
                continue
            waited_s += GLANCE_S
            if needs is not None:
                needs.check()
            if waited_s >= PATIENCE_S:
                raise self._silent

    @property
    def _silent(self) -> DeviceFault:
        return DeviceFault(self._name, f"nothing came for {PATIENCE_S:g} s")

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


def _serve(
    pipe: Connection,
    theirs: Sequence[Connection],
    cores: tuple[int, int] | None,
    make: Callable[..., Work],
    shared: Sequence[object],
) -> None:
    """The process: works off jobs in their order; one that fails ends it, and the controller learns why."""
    for other in theirs:  # else the controller's death would not end the pipes
        other.close()
    # Signals often go to all processes of a group: this one lives until the controller has stopped the arm.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    cv2.setNumThreads(1)  # of a process that is no copy
    # The other cores have work of their own: no threads for triangles where MuJoCo renders in software.
    os.environ.setdefault("LP_NUM_THREADS", "0")
    gc.freeze()  # what came with the copy stays shared
    leave_controllers_core(cores)
    try:
        work = make(*shared, *pipe.recv())
        while True:
            number, job = pipe.recv()
            pipe.send((number, work(job)))
    except (EOFError, OSError):
        return  # the controller is gone
    except BaseException as error:
        with suppress(OSError):
            pipe.send((None, f"{type(error).__name__}: {error}"))
