"""Which process works on which core where there are just two: where all share both, everyone waits for everyone.

One core is the controller's alone. While it waits for an answer, that core is lent to what the answer waits for.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress


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
