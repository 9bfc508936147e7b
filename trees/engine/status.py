"""The statuses of a node: py_trees' four, and SKIPPED, for which it has no word."""

from __future__ import annotations

from py_trees import display
from py_trees.common import Status

from cell.errors import CellError


class NodeError(CellError):
    """A node cannot do its work in this tick: it fails, and this is its feedback message.

    Examples: an input port reads an entry that nothing has written yet, a script divides by zero.
    """


def _fifth_status() -> Status:
    """A member that py_trees' class does not spell out, made as `enum.Flag` makes its combined ones."""
    skipped = object.__new__(Status)
    skipped._name_ = skipped._value_ = "SKIPPED"
    for symbols in (display.unicode_symbols, display.ascii_symbols, display.xhtml_symbols):
        symbols[skipped] = symbols[Status.INVALID]
    return skipped


IDLE = Status.INVALID
RUNNING = Status.RUNNING
SUCCESS = Status.SUCCESS
FAILURE = Status.FAILURE
SKIPPED = _fifth_status()
# What stands in logs; an idle node's is py_trees' word.
STATUSES = {status.name: status for status in (IDLE, RUNNING, SUCCESS, FAILURE, SKIPPED)}

Results = frozenset[Status]  # how a node can end; the empty one is that of a node that never ends
NEVER: Results = frozenset()
EITHER: Results = frozenset((SUCCESS, FAILURE))
ANY: Results = EITHER | {SKIPPED}
