"""Experiments that anyone can repeat: cells that are measured once, and kept in a file.

A cell is kept under all that it depends on: its key (settings, seed, product and what else is varied) and the code
that measures it. So an interrupted series goes on where it stopped, and what changed is measured anew.
"""

from __future__ import annotations

import ast
import hashlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from bracket_ground.files.row_store import RowStore

Key = Mapping[str, Any]  # of what JSON can hold
Values = dict[str, Any]
Cells = Sequence[tuple[Key, Values]]
_ROOT = Path(__file__).parents[2]


@dataclass(frozen=True)
class Cell:
    """One run of an experiment: what is varied, and what measures it."""

    key: Key
    measure: Callable[[], Values]

    @property
    def name(self) -> str:
        """Identity of key and code."""
        measure = self.measure.func if isinstance(self.measure, partial) else self.measure
        text = json.dumps([dict(self.key), code_version(measure.__module__)], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:24]


def kept(path: Path) -> RowStore:
    """The cells of a file, lines {"name": ..., "key": {...}, "values": {...}}, written after every cell.

    Raises:
        InputError: the file holds something else, or cannot be read or written.
    """
    return RowStore(path, ["name"])


def measured(title: str, cells: Sequence[Cell], store: RowStore, *, quiet: bool = False) -> Cells:
    """Keys and values of all cells; measures those that are not in the store."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    missing = {cell.name: cell for cell in cells if cell.name not in store}
    with Progress(*columns, console=Console(stderr=True), disable=quiet, transient=True) as progress:
        shown = progress.add_task(title, total=len(cells), completed=len(cells) - len(missing))
        for name, cell in missing.items():
            store.add({"name": name, "key": dict(cell.key), "values": cell.measure()})
            progress.advance(shown)
    return [(cell.key, store[cell.name]["values"]) for cell in cells]


@cache
def code_version(module: str) -> str:
    """Hash of a module and of all of the project that it imports, docstrings and comments apart."""
    known: dict[str, str] = {}
    waiting = [module]
    while waiting:
        name = waiting.pop()
        path = _ROOT.joinpath(*name.split(".")).with_suffix(".py")
        if name in known or not path.is_file():
            continue
        tree = ast.parse(path.read_text("utf-8"))
        waiting += _imported(tree)
        known[name] = ast.dump(tree)
    return hashlib.sha256(json.dumps(sorted(known.items())).encode()).hexdigest()[:24]


def _imported(tree: ast.Module) -> Iterator[str]:
    """Names of modules, or of what is in them; takes docstrings out of the tree on its way."""
    for node in ast.walk(tree):
        for block in ("body", "orelse", "finalbody"):
            if isinstance(lines := getattr(node, block, None), list):
                lines[:] = [line for line in lines if not _says_only(line)]
        if isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


def _says_only(line: ast.AST) -> bool:
    """Whether a statement is nothing but a text."""
    return isinstance(line, ast.Expr) and isinstance(line.value, ast.Constant)
