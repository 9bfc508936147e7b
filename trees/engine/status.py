"""The statuses of a node, and the error that makes it fail."""

from __future__ import annotations

from enum import Enum

from cell.errors import CellError


class NodeError(CellError):
    """A node cannot do its work in this tick: it fails, and this is its feedback message.

    Examples: an input port reads an entry that nothing has written yet, a script divides by zero.
    """


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
