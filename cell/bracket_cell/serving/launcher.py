"""Begins runs, each a process of its own that outlives the server, and knows which of them goes on."""

from __future__ import annotations

import fcntl
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path

from bracket_cell.viewing.gate import SOCKET
from bracket_ground.errors import InputError

LINES_N = 12  # of what a run printed last that say why it did not begin


class Launcher:
    """Begins `cell run` with the same options each time.

    A run holds a lock of the operating system as long as it lives, whoever began it: a server that comes later knows
    of it, and nothing is left behind by one that was killed. It serves its page at a socket in the folder.

    Args:
        folder: for lock, socket and the output of the run; of the logs, too.
        book: that each run is written into.
        words: options of `cell run`.

    Attributes:
        socket: where the run serves its page.
    """

    def __init__(self, folder: Path, book: Path, words: Sequence[str]) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._folder, self._book, self._words = folder, book, tuple(words)
        self.socket, self._lock, self._out = folder / "run.sock", folder / "run.lock", folder / "run.out"
        self._child: subprocess.Popen[bytes] | None = None

    @property
    def busy(self) -> bool:
        """Whether a run goes on, begins or ends."""
        if self._child is not None:
            self._child.poll()
        with self._locked() as free:
            return free is None

    @property
    def problem(self) -> str:
        """What the run said that this server began and that refused its input; empty where there is none."""
        if self._child is None or self._child.poll() in (None, 0, 1, 3):  # ended as runs end, or goes on
            return ""
        lines = self._out.read_text("utf-8", "replace").splitlines()
        complaints = [line for line in lines[-LINES_N:] if line.startswith(("cell: ", "  "))]
        return "\n".join(complaints or lines[-1:]).removeprefix("cell: ")

    def begin(self, operator: str, resumed: Path | None = None, more: Sequence[str] = ()) -> None:
        """Begin a run.

        Args:
            operator: who begins it, for the book.
            resumed: log of the run that this one goes on with.
            more: further options.

        Raises:
            InputError: one goes on, or the process could not be started.
        """
        log = self._folder.parent / f"{datetime.now():%Y%m%d-%H%M%S}.mcap"
        words = ["--log", str(log), f"--page={SOCKET}{self.socket}", "--book", str(self._book)]
        words += ["--operator", operator] if operator else []
        words += [] if resumed is None else ["--resume", str(resumed)]
        command = [sys.executable, "-m", "bracket_cell", "run", *self._words, *words, *more]
        with self._locked() as lock, self._out.open("wb") as out:
            if lock is None:
                raise InputError("a run goes on already")
            try:
                self._child = subprocess.Popen(
                    command, stdin=subprocess.DEVNULL, stdout=out, stderr=out, start_new_session=True, pass_fds=[lock]
                )
            except OSError as error:
                raise InputError(f"the run cannot be started: {error.strerror}") from None

    @contextmanager
    def _locked(self) -> Iterator[int | None]:
        """The lock, as long as nobody else has it; a process that inherits it keeps it."""
        self._folder.mkdir(parents=True, exist_ok=True)
        lock = os.open(self._lock, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            yield None
        else:
            yield lock
        finally:
            os.close(lock)
