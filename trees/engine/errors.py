"""Errors of a running tree; what is wrong with a file is an InputError."""

from __future__ import annotations

from cell.interfaces.errors import CellError


class NodeError(CellError):
    """A node cannot do its work in this tick: it fails, and this is its feedback message.

    Examples: an input port reads an entry that nothing has written yet, a script divides by zero.
    """
