"""Asks the operating system to run this thread before others, where it is permitted."""

from __future__ import annotations

import os

PRIORITY = 10


def prefer(priority: int = PRIORITY) -> bool:
    """Run this thread under SCHED_FIFO from now on; what it starts does not. False where that is not permitted."""
    try:
        policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
        os.sched_setscheduler(0, policy, os.sched_param(priority))
    except (AttributeError, OSError):
        return False
    return True
