"""Errors of trees, and places in tree files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


class TreeError(Exception):
    """Root of all errors that the engine raises on purpose."""


@dataclass(frozen=True)
class Place:
    """A place in a file; lines and columns count from 1."""

    file: Path
    line: int | None = None
    column: int | None = None

    def __str__(self) -> str:
        return ":".join(str(part) for part in (self.file, self.line, self.column) if part is not None)


@dataclass(frozen=True)
class Problem:
    """One mistake in a tree file: where it is, what is wrong and what would be legal."""

    place: Place
    what: str
    legal: str = ""

    def __str__(self) -> str:
        return f"{self.place}: {self.what}" + (f"; {self.legal}" if self.legal else "")


class TreeFileError(TreeError):
    """A tree file, or a name given for it, is wrong; nothing was ticked.

    Attributes:
        problems: all mistakes, in the order of the files' lines.
    """

    def __init__(self, *problems: Problem | str) -> None:
        self.problems = problems
        super().__init__("\n".join(str(problem) for problem in problems))


class NodeError(TreeError):
    """A node cannot do its work in this tick: it fails, and this is its feedback message.

    Examples: an input port reads an entry that nothing has written yet, a script divides by zero.
    """


class TraitError(TreeError, TypeError):
    """A class describes itself in a way that nothing reads."""
