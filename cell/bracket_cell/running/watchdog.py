"""A thread that does not depend on the loop: it sees that ticks come, and that a run ends which a signal is to end."""

from __future__ import annotations

import os
import select
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType

from bracket_cell.remote.child import kill_all
from bracket_cell.running.safe_stop import STOPPING, StopSignals, failure
from btxml.engine.node import TreeNode

TICK_S = 1.0  # at real pace; without a tick for so long the arm is ordered to stop
TAKEN_S = 0.5  # in which that order must be taken
BREAK_S, END_S = 1.0, 0.6  # after a signal: a step that lasts longer is broken off, and then the process is ended
MOST_PATIENCE = 4.0
APART_S = 0.2  # signals that are nearer together are one wish: a terminal and a wrapper may both send it
GLANCE_S, PING_S = 0.1, 0.4
PRIORITY = 20
NOTHING_MOVED, NOT_KNOWN = "nothing has moved", "the arm is not known to stand"

os.register_at_fork(after_in_child=lambda: signal.set_wakeup_fd(-1))  # a forked child's signals are not this process's


class Watchdog:
    """Watches one run.

    Attributes:
        signals: those that end a run.
        limit_s: how long a tick may take; None for ever, as where time is simulated.
        left: how arm and gripper are left where the process has to be ended at once.
        news: what was said since somebody emptied it, for the log.
    """

    def __init__(self) -> None:
        self.signals, self.left = StopSignals(), NOTHING_MOVED
        self.limit_s: float | None = None
        self.news: list[str] = []
        self._stop: Callable[[], object] | None = None  # as long as ticks must come
        self._step, self._step_s, self._tick_s = "beginning", time.monotonic(), time.monotonic()
        self._told = False
        self._wishes: list[float] = []  # when somebody wanted the run to end
        self._broken_s: float | None = None
        self._own = 0  # signals of this thread's own that come back
        self._main = threading.main_thread().ident or 0

    @contextmanager
    def watching(self) -> Iterator[Watchdog]:
        """From here to the end of the block; within itself it does nothing."""
        if self.signals.taken:
            yield self
            return
        ours, theirs = socket.socketpair()
        theirs.setblocking(False)
        before = signal.set_wakeup_fd(theirs.fileno(), warn_on_full_buffer=False)
        thread = threading.Thread(target=self._watch, args=(ours,), name="watchdog", daemon=True)
        try:
            with self.signals.handled():
                thread.start()
                yield self
        finally:
            signal.set_wakeup_fd(before)
            theirs.close()  # which ends the thread
            thread.join(2 * TAKEN_S)

    @contextmanager
    def ticks(self, stop: Callable[[], object]) -> Iterator[None]:
        """In this block ticks come.

        Args:
            stop: orders the arm to stop; called in a thread of its own.
        """
        self.tick()
        self._stop, self.left = stop, NOT_KNOWN
        notify("READY=1")
        try:
            yield
        finally:
            self._stop = None

    def stopping(self) -> None:
        """The safe stop begins."""
        self.step("the safe stop")
        notify("STOPPING=1")

    def tick(self) -> None:
        """A tick begins."""
        self._tick_s, self._told = time.monotonic(), False

    def step(self, what: str) -> None:
        """Something else begins: what it does, in words."""
        self._step, self._step_s = what, time.monotonic()

    def _watch(self, woken: socket.socket) -> None:
        with suppress(AttributeError, OSError):  # before the loop, where that is permitted
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
        poll, notified_s = select.poll(), 0.0
        poll.register(woken, select.POLLIN)
        with woken:
            while True:
                came = woken.recv(256) if poll.poll(1e3 * GLANCE_S) else None
                if came == b"":
                    return
                now_s = time.monotonic()
                self._hear(came or b"", now_s)
                self._see_ending(now_s)
                self._see_ticks(now_s)
                if self._stop is not None and not self._told and now_s - notified_s >= PING_S:
                    notified_s = now_s
                    notify("WATCHDOG=1")

    def _hear(self, numbers: bytes, now_s: float) -> None:
        for _ in [number for number in numbers if number in STOPPING]:
            if self._own:
                self._own -= 1
            elif not self._wishes or now_s - self._wishes[-1] > APART_S:
                self._wishes.append(now_s)
        if len(self._wishes) > 2:
            self._end()

    def _see_ending(self, now_s: float) -> None:
        """After a signal no step may last: it is broken off, once, and then the process is ended."""
        if not self._wishes:
            return
        since_s, patience = max(self._wishes[0], self._step_s), self._patience
        if self._broken_s is None and now_s - since_s > BREAK_S * patience:
            self._broken_s, self._own = now_s, self._own + 1
            signal.pthread_kill(self._main, signal.SIGINT)
        elif self._broken_s is not None and now_s - max(since_s, self._broken_s) > END_S * patience:
            self._end()

    @property
    def _patience(self) -> float:
        """Where time is simulated, steps may last longer on a machine with more to do: the log must be closed."""
        if self.limit_s is not None:
            return 1.0
        return min(max(1.0, os.getloadavg()[0] / (os.cpu_count() or 1)), MOST_PATIENCE)

    def _see_ticks(self, now_s: float) -> None:
        late_s = now_s - self._tick_s
        if self._stop is None or self.limit_s is None or self._told or late_s < self.limit_s:
            return
        self._told = True
        where = self._where()
        self._say(f"no tick for {late_s:.1f} s: {self._step} hangs{where}; {_ordered(self._stop)}")

    def _where(self) -> str:
        """The node and the line that the main thread is in."""
        frame: FrameType | None = sys._current_frames().get(self._main)
        if frame is None:
            return ""
        line = f"{Path(frame.f_code.co_filename).name}:{frame.f_lineno}"
        while frame is not None:
            if isinstance(node := frame.f_locals.get("self"), TreeNode):
                return f" in {node.full_path or type(node).__name__} ({line})"
            frame = frame.f_back
        return f" ({line})"

    def _say(self, text: str) -> None:
        self.news.append(text)
        with suppress(OSError):  # nobody reads it
            os.write(2, f"cell: {text}\n".encode())

    def _end(self) -> None:
        """End the process and its children, whatever they do."""
        self._say(f"ended at once by {self.signals.name or 'a signal'}: {self.left}")
        kill_all()
        os._exit(3 if "known" in self.left else 1)


def _ordered(stop: Callable[[], object]) -> str:
    """How an order to stop the arm was taken."""
    answers: list[str] = []
    thread = threading.Thread(target=lambda: answers.append(failure(stop)), name="stop", daemon=True)
    thread.start()
    thread.join(TAKEN_S)
    if not answers:
        return f"the arm did not take the order to stop within {TAKEN_S:g} s; {NOT_KNOWN}"
    return f"the arm did not stop: {answers[0]}; {NOT_KNOWN}" if answers[0] else "the arm was ordered to stop"


def notify(text: str) -> None:
    """Tell the service manager, where there is one (sd_notify of systemd)."""
    address = os.environ.get("NOTIFY_SOCKET", "")
    if address:
        with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
            manager.sendto(text.encode(), f"\0{address[1:]}" if address.startswith("@") else address)
