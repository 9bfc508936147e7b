"""The statuses of a node."""

from __future__ import annotations

from enum import Enum


class Status(Enum):
    """How a node stands, or what it answered to a tick.

    Attributes:
        INVALID: idle: not begun, halted, or forgotten by its parent; py_trees' word, as it stands in logs.
        SKIPPED: it was not to be ticked now; it did nothing, and counts as idle.
    """

    INVALID = "INVALID"
    RUNNING = "RUNNING"
    SUCCESS = "SUCCESS"
    FAILURE = "FAILURE"
    SKIPPED = "SKIPPED"


IDLE = Status.INVALID
RUNNING = Status.RUNNING
SUCCESS = Status.SUCCESS
FAILURE = Status.FAILURE
SKIPPED = Status.SKIPPED
STATUSES = {status.name: status for status in Status}  # by what stands in logs

Results = frozenset[Status]  # how a node can end; the empty one is that of a node that never ends
NEVER: Results = frozenset()
EITHER: Results = frozenset((SUCCESS, FAILURE))
ANY: Results = EITHER | {SKIPPED}
