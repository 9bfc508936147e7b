"""Functions that workers of a test import."""

from __future__ import annotations

import errno
import math
import os
import signal
import time
from pathlib import Path

from bracket_cell.fleet.one_run import in_child, limited
from bracket_cell.fleet.task import Task
from bracket_ground.errors import InputError


class Awkward(Exception):
    """One that pickle takes, and cannot make again."""

    def __init__(self, what: str, why: str) -> None:
        super().__init__(f"{what}: {why}")


def awkward() -> None:
    """Raises it."""
    raise Awkward("the run", "it is odd")


def squared(number: int, kill_once: str) -> int:
    """The first time that a file is named that is not there, it is made and the process killed."""
    if kill_once and not Path(kill_once).exists():
        Path(kill_once).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    if number < 0:
        raise InputError(f"no root: {number}")
    return number**2


def factorial(number: int) -> int:
    """Of a negative number it kills its process."""
    if number < 0:
        os.kill(os.getpid(), signal.SIGKILL)
    return math.factorial(number)


def row(task: Task) -> dict[str, object]:
    """As a run answers, after a moment, from the child process that a run has."""
    return in_child(run_row, task.seed)


def row_on_disk(task: Task) -> dict[str, object]:
    """As `row`, and writes something to the disk that the worker's environment names first."""
    with Path(os.environ.get("DISK_OF_TEST", os.devnull)).open("w") as file:
        file.write("a row")
    return {**row(task), "key": task.key}


def run_row(seed: int) -> dict[str, object]:
    time.sleep(0.05)
    return {"key": str(seed), "seed": seed, "end": "finished", "took_s": 0.05}


def busy(for_s: float) -> float:
    """Works for so long; returns how long that was."""
    began_s = time.monotonic()
    while time.monotonic() - began_s < for_s:
        sum(range(1000))
    return time.monotonic() - began_s


def spin() -> None:
    """Uses the processor until it may no more."""
    with limited(0.5):
        while True:
            pass


def row_of_the_sound(task: Task) -> dict[str, object]:
    """As a run on a machine whose first worker has a full disk."""
    from distributed import get_worker

    if get_worker().name == 0:
        raise OSError(errno.ENOSPC, "No space left on device")
    return {"key": task.key, "seed": task.seed, "end": "finished", "took_s": 0.0}
