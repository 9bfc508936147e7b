"""Processes that tests start: none outlives its test, whatever the test does."""

from __future__ import annotations

import os
import signal
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

SLOW_MACHINE_S = 1800.0  # a limit against waiting for ever; a busy machine keeps it


@contextmanager
def started(
    command: Sequence[str], cwd: Path | None = None, environment: Mapping[str, str] | None = None
) -> Iterator[subprocess.Popen[str]]:
    """A process with its output in pipes; it and what it started are killed at the end if they still run."""
    process = subprocess.Popen(
        command,
        cwd=cwd,
        env={**os.environ, **(environment or {})},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    with process:
        try:
            yield process
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)


def finished(
    command: Sequence[str],
    cwd: Path | None = None,
    environment: Mapping[str, str] | None = None,
    limit_s: float = SLOW_MACHINE_S,
) -> subprocess.CompletedProcess[str]:
    """Run a command to its end; raises subprocess.TimeoutExpired after the limit."""
    with started(command, cwd, environment) as process:
        out, err = process.communicate(timeout=limit_s)
        return subprocess.CompletedProcess(command, process.returncode, out, err)


def children() -> dict[int, str]:
    """Command lines of this process's children that still run, by process id (Linux); a new one may have none yet."""
    ids = [int(word) for task in Path("/proc/self/task").iterdir() for word in _read(task / "children").split()]
    return {id_: " ".join(_read(Path(f"/proc/{id_}/cmdline")).split("\0")) for id_ in ids if runs(id_)}


def runs(process: int) -> bool:
    """Whether a process is there and is no zombie (Linux)."""
    state = _read(Path(f"/proc/{process}/stat")).rpartition(")")[2].split()
    return bool(state) and state[0] not in "ZX"


def _read(path: Path) -> str:
    try:
        return path.read_text()
    except OSError:  # it has ended meanwhile
        return ""
