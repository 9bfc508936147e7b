"""Figures as docs/figures holds them: a file for each page, its tables, their rows; who measures writes them there."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Literal

from pydantic import Field, model_validator

from bracket_ground.errors import InputError
from bracket_ground.files.files import write_whole
from bracket_ground.files.model import Model
from bracket_ground.files.yaml_file import load_yaml

PAPER = Path(__file__).with_name("paper.yaml")


class PrintedTable(Model):
    """A table or figure of the paper.

    Attributes:
        conditions: how the paper counted.
        rows: figures as printed, by the condition of the row and that of the column.
    """

    conditions: str
    rows: Mapping[str, Mapping[str, str]]


class Paper(Model):
    """The file.

    Attributes:
        tables: by their names in the paper.
        algorithm_1: first and last printed line by node.
    """

    tables: Mapping[str, PrintedTable]
    algorithm_1: Mapping[str, tuple[int, ...]] = Field(alias="algorithm 1")

    def printed(self, place: str, beside: str) -> str:
        """The figure at TABLE/ROW/COLUMN.

        Args:
            beside: what our own figure says of itself; it must name the same conditions.

        Raises:
            InputError: there is no such figure, or ours was measured under other conditions.
        """
        table, row, column = place.split("/")
        try:
            figure = self.tables[table].rows[row][column]
        except KeyError:
            raise InputError(f"{PAPER.name}: no figure {place!r}") from None
        if lacking := [words for words in (table, row, column) if words not in beside]:
            raise InputError(f"{place!r} stands beside {beside!r}, which does not say {', '.join(lacking)}")
        return figure


@cache
def paper() -> Paper:
    """The paper's numbers."""
    return load_yaml(PAPER, Paper)


FIGURES = Path(__file__).parents[3] / "docs" / "figures"  # of a clone
Number = int | float | str


class Row(Model):
    """One figure.

    Attributes:
        claim: the measured quantity, with its unit.
        interval, n: of 95 %, from and to, unknown where nobody estimated it; how many were counted.
        trivial: what an answer without looking gets.
        paper: the paper's figure under the same conditions, as TABLE/ROW/COLUMN of its file.
        met: whether the measured value meets the bar.
        command, commit, release: what measured it, and where.
        note: what a reader must know to compare it.
    """

    claim: str
    figure: Number
    interval: tuple[float, float] | Literal["unknown"]
    n: int | str
    trivial: Number | None = None
    bar: Number | None = None
    paper: str | None = None
    met: bool | None = None
    command: str
    commit: str
    release: str
    note: str | None = None

    @model_validator(mode="after")
    def _bar_and_verdict(self) -> Row:
        if (self.bar is None) != (self.met is None):
            raise ValueError(f"{self.claim}: a bar needs a verdict, and a verdict a bar")
        return self


class Table(Model):
    """Figures that belong together: as rows, or as a table with columns of its own (`head`, `cells`).

    Attributes:
        command, commit, release: of the cells.
    """

    title: str
    about: str = ""
    command: str | None = None
    commit: str | None = None
    release: str | None = None
    rows: tuple[Row, ...] = ()
    head: tuple[str, ...] = ()
    cells: tuple[tuple[str, ...], ...] = ()

    def printed(self, row: Row) -> Row:
        """A row with the paper's own figure in the place of where it is printed.

        Raises:
            InputError: the paper has none there, or counted it under other conditions than this row.
        """
        if row.paper is None:
            return row
        return row.model_copy(update={"paper": paper().printed(row.paper, f"{self.title}: {row.claim}")})

    def with_rows(self, rows: Iterable[Row]) -> Table:
        """The same with these rows, each in the place of that of the same claim, new ones at the end."""
        merged = {row.claim: row for row in (*self.rows, *rows)}
        return self.model_copy(update={"rows": tuple(merged.values())})


class Topic(Model):
    """A file of figures."""

    title: str
    about: str = ""
    tables: tuple[Table, ...]


def topics(folder: Path = FIGURES) -> dict[str, Topic]:
    """All files of figures, by name."""
    return {path.stem: Topic.model_validate_json(path.read_text()) for path in sorted(folder.glob("*.json"))}


def write_rows(page: str, title: str, rows: Iterable[Row], folder: Path = FIGURES) -> None:
    """Write measured rows into a table of a page; a table that there is not yet comes last.

    Raises:
        InputError: there is no such page.
    """
    known = topics(folder)
    if page not in known:
        raise InputError(f"no page of figures {page!r}; there are: {', '.join(known)}")
    tables = {table.title: table for table in known[page].tables}
    tables[title] = tables.get(title, Table(title=title)).with_rows(rows)
    written = known[page].model_copy(update={"tables": tuple(tables.values())})
    write_whole(folder / f"{page}.json", _text(written).encode())


def _text(topic: Topic) -> str:
    """JSON with each row, and each line of cells, on a line of its own."""
    fields, lines = topic.model_dump(mode="json", exclude_defaults=True), list[str]()

    def line(value: object) -> str:
        lines.append(json.dumps(value, ensure_ascii=False))
        return f"@{len(lines) - 1}@"

    for table in fields["tables"]:
        table |= {name: [line(row) for row in table[name]] for name in ("rows", "cells") if name in table}
        table |= {"head": line(table["head"])} if "head" in table else {}
    text = json.dumps(fields, indent=1, ensure_ascii=False)
    return re.sub(r'"@(\d+)@"', lambda found: lines[int(found[1])], text) + "\n"
