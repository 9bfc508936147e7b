"""Commands that a command runs beside itself and waits for: none goes on without it."""

from __future__ import annotations

import os
import signal
import subprocess
import threading
from collections.abc import Sequence
from contextlib import suppress
from typing import IO

from cell.commands.terminal import BESIDE

GRACE_S = 2.0  # a terminal tells them of Ctrl-C by itself: a second one would break off how they end
LONGEST_S = 20.0  # to end; what began in the background of a shell does not hear of SIGINT


class Children:
    """Runs commands, each waited for by a thread of its own, until they are interrupted together."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._running: list[subprocess.Popen[bytes]] = []
        self._ended = False

    def run(self, words: Sequence[str], told: IO[str] | None, complaints: IO[str] | None = None) -> int:
        """Run one to its end; returns its status. Once they were interrupted, nothing begins any more.

        Args:
            told: file for what it says; the terminal by default.
            complaints: file for what it says on standard error; by default the same.
        """
        with self._lock:
            if self._ended:
                return -signal.SIGINT
            beside = {**os.environ, BESIDE: "1"}
            process = subprocess.Popen(words, stdout=told, stderr=complaints or told, env=beside)
            self._running.append(process)
        status = process.wait()
        with self._lock:
            self._running.remove(process)
        return status

    def interrupt(self) -> None:
        """As Ctrl-C does, for those that have not heard of it; those that go on all the same are terminated."""
        with self._lock:
            self._ended, running = True, tuple(self._running)
        for process in running:
            try:
                process.wait(GRACE_S)
            except subprocess.TimeoutExpired:
                with suppress(ProcessLookupError):
                    process.send_signal(signal.SIGINT)
        for process in running:
            try:
                process.wait(LONGEST_S)
            except subprocess.TimeoutExpired:
                process.terminate()
