"""Finished cells of experiments in a small file: what has been computed is not computed again."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from cell.interfaces.errors import InputError, Place, Problem

Key = Mapping[str, object]  # of what JSON can hold
Values = dict[str, Any]


@dataclass(frozen=True)
class Cell:
    """One run of an experiment: what is varied, and what measures it."""

    key: Key
    measure: Callable[[], Values]


class Store:
    """A file of JSON lines, {"key": {...}, "values": {...}}; written after every cell, so that nothing is lost."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._done: dict[str, Values] = {}
        if not path.exists():
            return
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
            try:
                read = json.loads(line)
                self._done[_name(read["key"])] = read["values"]
            except (ValueError, TypeError, KeyError) as error:
                what = f"no finished cell of an experiment: {error!r}"
                raise InputError(Problem(Place(path, number), what, "remove the line, or the file")) from error

    def run(self, title: str, cells: Sequence[Cell], *, quiet: bool = False) -> list[tuple[Key, Values]]:
        """Keys and values of all cells; measures those that are not in the file."""
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
        with Progress(*columns, console=Console(stderr=True), disable=quiet, transient=True) as progress:
            found = []
            for cell in progress.track(cells, description=title):
                if _name(cell.key) not in self._done:
                    self._keep(cell.key, cell.measure())
                found.append((cell.key, self._done[_name(cell.key)]))
        return found

    def _keep(self, key: Key, values: Values) -> None:
        self._done[_name(key)] = values
        self._path.parent.mkdir(parents=True, exist_ok=True)
        with self._path.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps({"key": dict(key), "values": values}) + "\n")


def _name(key: Key) -> str:
    return json.dumps(dict(key), sort_keys=True)
