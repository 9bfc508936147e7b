"""Processes of this one's own: each dies with it, however that ends, and none is waited for without a limit."""

from __future__ import annotations

import atexit
import ctypes
import multiprocessing
import os
import pickle
import signal
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO
from weakref import WeakSet

KILLED_S = 1.0  # so long it is waited for; on a busy machine it may take longer, and nobody needs to see it
OUTLIVED = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
BEGIN = "from bracket_cell.remote.child import begin; begin()"
PR_SET_PDEATHSIG = 1

Serve = Callable[[socket.socket], None]
_living: WeakSet[Child] = WeakSet()
_dying: list[Child] = []  # Python complains of one that is forgotten


class Child:
    """One process, and our end of the connection to it; close it.

    Signals often go to all processes of a terminal or a group: a child outlives those that end its parent, as it is
    needed until that has stopped the arm.

    Args:
        name: for people; `ps` shows it where the process is no copy.
        serve: runs there, with the other end of the connection; to a process that is no copy it goes pickled, in a file
            without a name that nobody else can open.
        handles: file handles that it needs, too.
        copied: begin as a copy of this process, see `may_copy`.
        outlives: it is no copy, and ends by itself some time after the connection did, whatever happens here: it leaves
            something in order.
    """

    def __init__(
        self, name: str, serve: Serve, handles: Sequence[int] = (), copied: bool = False, outlives: bool = False
    ) -> None:
        self.name = name
        self.socket, theirs = socket.socketpair()
        with theirs:
            if copied:
                self._process = multiprocessing.get_context("fork").Process(
                    target=_run, args=(os.getpid(), serve, theirs), name=name, daemon=True
                )
                self._process.start()
                self.process_id = self._process.pid or 0
                self._waited: Callable[[float], int | None] = self._joined
            else:
                started = _executed(name, serve, theirs.fileno(), handles, outlives)
                self.process_id, self._waited = started.pid, lambda limit_s: _code(started, limit_s)
        if not outlives:
            _living.add(self)

    def __str__(self) -> str:
        return f"{self.name} (pid {self.process_id})"

    def code(self, limit_s: float = 0.0) -> int | None:
        """Its exit code once it has ended, which is waited for within the limit; None while it runs."""
        return self._waited(limit_s)

    @property
    def halted(self) -> bool:
        """Whether somebody stopped it by a signal, and it waits to be told to go on (Linux)."""
        try:
            return Path(f"/proc/{self.process_id}/stat").read_text().rpartition(")")[2].split()[0] in "Tt"
        except (OSError, IndexError):
            return False

    def close(self, limit_s: float = 0.0) -> None:
        """End it, by force where it has not ended within the limit; harmless when repeated."""
        self.socket.close()
        if self.code(limit_s) is None:
            with suppress(ProcessLookupError):
                os.kill(self.process_id, signal.SIGKILL)
            if self.code(KILLED_S) is None:
                _dying.append(self)
        _living.discard(self)

    def _joined(self, limit_s: float) -> int | None:
        self._process.join(limit_s)
        return self._process.exitcode


def close_all() -> None:
    """End all children of this process: else Python's exit would wait for copies that were stopped."""
    for child in list(_living):
        child.close()


def kill_all() -> None:
    """The same, where nobody waits for anything any more."""
    for child in list(_living):
        with suppress(ProcessLookupError):
            os.kill(child.process_id, signal.SIGKILL)


atexit.register(close_all)  # before multiprocessing's own, which is older


def may_copy() -> bool:
    """Whether a process can begin as a copy of this one, which saves it all imports.

    A copy has one thread, and graphics that have been used do not live on in it.
    """
    egl = sys.modules.get("mujoco.egl")
    unused = egl is not None and egl.EGL_DISPLAY is None
    return sys.platform == "linux" and unused and threading.active_count() == 1


def begin() -> None:
    """What a process begins with that is no copy."""
    with os.fdopen(os.dup(0), "rb") as given:
        parent, path, handle, serve = pickle.load(given)
    sys.path[:] = path
    _run(parent, pickle.loads(serve), socket.socket(fileno=handle))


def nameless_file() -> IO[bytes]:
    """A file in memory, where the system has such, that is gone with its last handle."""
    if hasattr(os, "memfd_create"):
        return os.fdopen(os.memfd_create("cell"), "w+b")
    return tempfile.TemporaryFile()


def _executed(name: str, serve: Serve, handle: int, handles: Sequence[int], outlives: bool) -> subprocess.Popen[bytes]:
    with nameless_file() as given:
        pickle.dump((0 if outlives else os.getpid(), sys.path, handle, pickle.dumps(serve)), given)
        given.seek(0)
        return subprocess.Popen(
            [sys.executable, "-c", BEGIN, name],
            stdin=given,
            pass_fds=(handle, *handles),
            env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
            process_group=0,
        )


def _code(process: subprocess.Popen[bytes], limit_s: float) -> int | None:
    with suppress(subprocess.TimeoutExpired):
        return process.wait(limit_s) if limit_s > 0 else process.poll()
    return None


def _run(parent: int, serve: Serve, connection: socket.socket) -> None:
    """The process: dies with its parent, unless that is 0, and serves until the connection ends."""
    for number in OUTLIVED:
        signal.signal(number, signal.SIG_IGN)
    with suppress(PermissionError):  # it leads its group already
        os.setpgid(0, 0)
    if parent and sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if parent and os.getppid() != parent:
        return
    for other in list(_living):  # of a copy: else the parent's death would not end these connections
        other.socket.close()
        _living.discard(other)
    with suppress(EOFError):
        serve(connection)


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
