"""Asks the operating system to run this thread before others, where it is permitted."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

PRIORITY = 10
HANDS_ON_S = 0.0005  # after which a thread that calculates lets others go on; Python's 5 ms add up to stalls of 60


@contextmanager
def preferred(wanted: bool = True) -> Iterator[bool]:
    """In this block the thread runs under SCHED_FIFO, what it starts does not; yields whether that is permitted.

    Other threads of the process hand the interpreter on to it sooner, permitted or not.
    """
    if not wanted:
        yield False
        return
    kept_s = sys.getswitchinterval()
    sys.setswitchinterval(HANDS_ON_S)
    try:
        with _first() as permitted:
            yield permitted
    finally:
        sys.setswitchinterval(kept_s)


@contextmanager
def _first() -> Iterator[bool]:
    try:
        before = os.sched_getscheduler(0), os.sched_getparam(0)
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(PRIORITY))
    except (AttributeError, OSError):
        yield False
        return
    try:
        yield True
    finally:
        os.sched_setscheduler(0, *before)
