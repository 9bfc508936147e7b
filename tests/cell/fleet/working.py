"""Functions that workers of a test import."""

from __future__ import annotations

import os
import signal
from pathlib import Path

from cell.errors import InputError


def squared(number: int, kill_once: str) -> int:
    """The first time that a file is named that is not there, it is made and the process killed."""
    if kill_once and not Path(kill_once).exists():
        Path(kill_once).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number**2


def refused(number: int) -> int:
    raise InputError(f"no such thing: {number}")


def dies() -> None:
    os.kill(os.getpid(), signal.SIGKILL)
