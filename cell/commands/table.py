"""A line of the table of commands."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Any


@dataclass(frozen=True)
class Command:
    """A command, or a group of commands.

    Attributes:
        target: "module:name" of a function or a typer application; of a group, that of its table.
        help: in one line, for the list of commands.
        panel: where it stands in the list; None for not there.
    """

    target: str
    help: str
    panel: str | None = None
    group: bool = False

    def load(self) -> Any:
        """What the target names."""
        module, _, name = self.target.partition(":")
        return getattr(import_module(module), name)


Table = Mapping[str, Command]
