"""What a part of a rotated log must say at its beginning, so that it can be read alone."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from py_trees.common import Status

from cell.interfaces.command import Display
from cell.recording.schemas import plain, plain_or_text
from cell.watching.observer import TickRecord


class Snapshot:
    """Follows the statuses of all nodes and the display; asks for the blackboard when it is needed.

    Args:
        blackboard: what the tree's blackboard holds now.
    """

    def __init__(self, blackboard: Callable[[], Mapping[str, object]]) -> None:
        self._blackboard = blackboard
        self._display: Display | None = None
        self._statuses: dict[str, str] = {}

    def follow(self, record: TickRecord) -> None:
        """One more tick is done."""
        self._display = record.command.display or self._display
        for change in record.changes:
            if change.new is Status.INVALID:
                self._statuses.pop(change.path, None)
            else:
                self._statuses[change.path] = change.new.name

    def forget_nodes(self) -> None:
        """Another tree takes over."""
        self._statuses.clear()

    def fields(self, tick: int) -> dict[str, Any]:
        """The message before a tick."""
        return {
            "tick": tick,
            "statuses": self._statuses,
            "blackboard": {name: plain_or_text(value) for name, value in self._blackboard().items()},
            "display": plain(self._display),
        }
