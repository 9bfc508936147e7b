"""Experiments that anyone can repeat: cells that are measured once, kept in a file, and written as a page of tables.

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

from bracket_ground.errors import InputError
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


def write_sections(head: str, sections: Sequence[str], out: Path, facts: Mapping[str, str]) -> None:
    """Write tables as a page, or as a file of figures (`.json`).

    Args:
        facts: command, date, machine and the like, for the head of the page.

    Raises:
        InputError: the page cannot be written.
    """
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        text = _figures(head, sections, facts) if out.suffix == ".json" else _page(head, sections, facts)
        out.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"{out}: cannot write the page: {error.strerror}") from error


def _page(head: str, sections: Sequence[str], facts: Mapping[str, str]) -> str:
    table = "| | |\n|---|---|\n" + "\n".join(f"| {name} | {fact} |" for name, fact in facts.items())
    return "\n\n".join([head, table, *sections]) + "\n"


def _figures(head: str, sections: Sequence[str], facts: Mapping[str, str]) -> str:
    """The file of figures (docs/figures) that stands for the page."""
    title, _, about = head.removeprefix("# ").partition("\n")
    stated = "; ".join(f"{name}: {fact}" for name, fact in facts.items() if name != "command")
    command = facts["command"].strip("`")
    tables = [{**table, "command": command} for section in sections for table in tables_of(section)]
    return json.dumps({"title": title, "about": f"{about.strip()} {stated}.", "tables": tables}, indent=1) + "\n"


def tables_of(section: str) -> Iterator[dict[str, Any]]:
    """The tables of a section in Markdown, each with its heading and the words before it."""
    title, about = "", ""
    for block in section.split("\n\n"):
        if block.startswith("|"):
            head, _, *cells = (line[2:-2].split(" | ") for line in block.splitlines())
            yield {"title": title, "about": about, "head": head, "cells": cells}
            about = ""
            continue
        if block.startswith("#"):
            heading, _, block = block.partition("\n")
            title, about = heading.lstrip("# "), ""
        about = f"{about} {block}".strip()


def values_of(cells: Cells, pick: Callable[[Values], float], **wanted: object) -> list[float]:
    """One number of every cell whose key has these entries."""
    return [pick(values) for key, values in cells if all(key.get(name) == value for name, value in wanted.items())]


def shown_share(cells: Cells, name: str, **wanted: object) -> str:
    """A share as text, with Wilson's interval; of several seeds their mean, and the ends of all their intervals."""
    found = [values for key, values in cells if wanted.items() <= dict(key).items()]
    shares, low, high = ([values[name + end] for values in found] for end in ("", "_low", "_high"))
    if not shares:
        return "-"
    return f"{number(sum(shares) / len(shares))} ({number(min(low))} - {number(max(high))})"


def number(value: float, digits: int = 3) -> str:
    """A number as text, without the zero before the point."""
    text = f"{value:.{digits}f}"
    return text[1:] if 0 < value < 1 and text[0] == "0" else text


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
