"""A process that works off jobs in the order in which they were sent (decision 6)."""

from __future__ import annotations

import gc
import os
import select
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from functools import partial
from typing import Any, Generic, TypeVar

import cv2

from bracket_cell.remote.channel import Channel, Failure, Message
from bracket_cell.remote.child import Child, leave_controllers_core, lent, two_cores
from bracket_ground.errors import CellError, DeviceFault

GLANCE_S = 0.5  # wall time between looks at other processes
PATIENCE_S = 60.0  # wall time; a job takes some milliseconds
DIED_S = 5.0  # in which one that hung up has an exit code
PING_S = 0.25  # after which one that has nothing to do is asked whether it is there

Job = TypeVar("Job", bound=Message)
Answer = TypeVar("Answer", bound=Message)


class NotAnswering(DeviceFault):
    """A process that runs does not answer in time; it may go on."""


class Ping(Message, frozen=True):
    """Are you there?"""


class Ready(Message, frozen=True):
    """Here I am: the answer to a ping, and to the beginning."""


class Pending(Generic[Answer]):
    """An answer that comes.

    Attributes:
        answer: None as long as it has not come.
    """

    def __init__(self) -> None:
        self.answer: Answer | None = None
        self.sent_s = time.monotonic()


class Worker(Generic[Job, Answer]):
    """One process; close it. What goes wrong in it is a fault for everybody who waits for it.

    Who waits for an answer reads what comes until it is there; there is no thread that does.

    Args:
        name: for faults.
        make: called in it; what it returns works off a job.
        jobs, answers: their types, unions of messages.
        handles: file handles that it needs.
        copied: begin as a copy of this process, see `may_copy`.
        came: called here with each answer; what it returns is handed out.
    """

    def __init__(
        self,
        name: str,
        make: Callable[[], Callable[[Job], Answer]],
        jobs: Any,
        answers: Any,
        handles: Sequence[int] = (),
        copied: bool = False,
        came: Callable[[Answer], Answer] = lambda answer: answer,
    ) -> None:
        self._came, self._cores = came, two_cores()
        cv2.setNumThreads(1)  # the other cores have work, and a copy would wait for OpenCV's threads, which it has not
        self.child = Child(name, partial(_work_off, make, jobs | Ping), handles, copied)
        self._channel: Channel[Any] = Channel(self.child.socket, answers | Failure | Ready)
        self._pending: deque[Pending[Any]] = deque([Pending()])  # first that it has begun
        self._sending, self._turn, self._reads = threading.Lock(), threading.Condition(), False
        self._fault: CellError | None = None
        self._heard_s = time.monotonic()

    def __str__(self) -> str:
        return str(self.child)

    @property
    def waiting(self) -> int:
        """Answers that have not come."""
        return len(self._pending)

    def check(self) -> None:
        """Raise why nothing more will come, where that is known."""
        if self._fault is not None:
            raise self._fault

    def send(self, job: Job | Ping, limit_s: float = PATIENCE_S) -> Pending[Answer]:
        """Begin a job; raises the fault of a process that failed, or did not read it in time."""
        pending: Pending[Answer] = Pending()
        with self._sending:
            self.check()
            self._pending.append(pending)
            try:
                self._channel.send(job, limit_s)
            except TimeoutError:
                self._fail(DeviceFault(str(self), f"does not read for {limit_s:g} s"))
            except EOFError:
                while self._fault is None:  # what it said before it died
                    self._read(GLANCE_S)
        return pending

    def awaited(self, pending: Pending[Answer], needs: Worker[Any, Any] | None = None) -> Answer:
        """The answer, which is waited for; raises the fault of a process that failed.

        Args:
            needs: a process that this one waits for: it has the controller's core meanwhile, and its fault is raised.
        """
        if pending.answer is None:
            late = needs is not None and not self._read(0.0)
            with lent(needs.child.process_id, self._cores) if needs is not None and late else nullcontext():
                self._read_until(pending, needs)
        assert pending.answer is not None
        return pending.answer

    def arrived(self, pending: Pending[Answer]) -> bool:
        """Whether an answer is here; never waits."""
        while pending.answer is None and self._fault is None and self._read(0.0):
            pass
        return pending.answer is not None

    @property
    def ready(self) -> bool:
        """Whether it has begun, and has done what it was given; never waits."""
        while self._pending and self._fault is None and self._read(0.0):
            pass
        self.check()
        return not self._pending

    def glance(self, limit_s: float) -> None:
        """Take what has come, and see that it is there; never waits.

        Raises:
            NotAnswering: nothing came for so long, though something was due.
            CellError: it has failed.
        """
        now_s = time.monotonic()
        if not self.ready:
            silent_s = now_s - max(self._heard_s, self._pending[0].sent_s)
            if silent_s > limit_s:
                raise NotAnswering(str(self), f"does not answer for {silent_s:.1f} s")
        elif now_s - self._heard_s > PING_S:
            self.send(Ping())

    def close(self) -> None:
        """End the process; harmless when repeated."""
        self.child.close()

    def _read_until(self, pending: Pending[Answer], needs: Worker[Any, Any] | None) -> None:
        until_s = time.monotonic() + PATIENCE_S
        while pending.answer is None:
            self.check()
            if self._read(GLANCE_S):
                continue
            if needs is not None:
                needs.glance(PATIENCE_S)
            if time.monotonic() > until_s:
                raise NotAnswering(str(self), f"does not answer for {PATIENCE_S:g} s")

    def _read(self, limit_s: float) -> bool:
        """Hand out the next answer that comes within a limit, or let the thread do so that reads already.

        Returns:
            whether something may have come.
        """
        with self._turn:
            if self._reads:
                return self._turn.wait(limit_s)
            self._reads = True
        try:
            self._take(self._channel.receive(limit_s))
        except TimeoutError:
            return False
        except EOFError:
            self._fail(self._why_gone())
        finally:
            with self._turn:
                self._reads = False
                self._turn.notify_all()
        return True

    def _take(self, answer: Any) -> None:
        self._heard_s = time.monotonic()
        if isinstance(answer, Failure):
            self._fail(answer.error(str(self)))
        else:
            self._pending.popleft().answer = answer if isinstance(answer, Ready) else self._came(answer)

    def _fail(self, error: CellError) -> None:
        self._fault = self._fault or error

    def _why_gone(self) -> DeviceFault:
        code = self.child.code(limit_s=DIED_S)
        return DeviceFault(str(self), f"it died (exit code {code})")


def await_ready(*workers: Worker[Any, Any], glance: Callable[[], object] = lambda: None) -> None:
    """Until all have begun, and have done what they were given.

    Args:
        glance: called twice a second; may raise what makes it useless to wait.

    Raises:
        CellError: one failed, somebody stopped it, or it takes too long.
    """
    until_s = time.monotonic() + PATIENCE_S
    while waiting := [worker for worker in workers if not worker.ready]:
        select.select([worker.child.socket for worker in waiting], [], [], GLANCE_S)
        glance()
        for worker in waiting:
            if worker.child.halted:
                raise NotAnswering(str(worker), "somebody stopped it")
            if time.monotonic() > until_s:
                raise NotAnswering(str(worker), f"is not ready after {PATIENCE_S:g} s")


def _work_off(make: Callable[[], Callable[[Any], Message]], jobs: Any, connection: socket.socket) -> None:
    """The process: works off jobs in their order; one that fails ends it, and the controller is told why."""
    cv2.setNumThreads(1)  # of a process that is no copy
    # The other cores have work of their own: no threads for triangles where MuJoCo renders in software.
    os.environ.setdefault("LP_NUM_THREADS", "0")
    gc.freeze()  # what came with the copy stays shared
    leave_controllers_core(two_cores())
    channel: Channel[Any] = Channel(connection, jobs)
    try:
        work = make()
        channel.send(Ready(), PATIENCE_S)
        while True:
            job = _next(channel)
            channel.send(Ready() if isinstance(job, Ping) else work(job), PATIENCE_S)
    except (EOFError, TimeoutError):
        return  # the controller is gone
    except BaseException as error:  # the process ends here: who asked is told why, whatever it was
        channel.send(Failure.of(error), PATIENCE_S)


def _next(channel: Channel[Any]) -> Any:
    while True:
        try:
            return channel.receive(PATIENCE_S)
        except TimeoutError:  # there is nothing to do
            continue
