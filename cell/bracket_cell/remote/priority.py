"""Asks the operating system to run this thread before others, where it is permitted."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

PRIORITY = 10


@contextmanager
def preferred(wanted: bool = True) -> Iterator[bool]:
    """In this block the thread runs under SCHED_FIFO, what it starts does not; yields whether that is permitted."""
    if not wanted:
        yield False
        return
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
