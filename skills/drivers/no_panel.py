"""A panel where there is none."""

from __future__ import annotations

from cell.interfaces.command import Display


class NoPanel:
    """Implements `Panel`; nobody reads it."""

    def show(self, display: Display) -> None:
        """Nothing happens."""

    def alarm(self, text: str) -> None:
        """Nothing happens."""

    def close(self) -> None:
        """Nothing to let go of."""
