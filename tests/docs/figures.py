"""docs/research/*.md: a page of tables for each JSON file of figures in docs/figures. `make pictures` writes them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Literal

from pydantic import model_validator

from bracket_ground.files.model import Model
from bracket_lab.evaluations.paper import paper
from bracket_lab.experiments.experiments import markdown
from tests import ROOT

FIGURES, PAGES = ROOT / "docs" / "figures", "docs/research"
RESULTS = "results"  # its page begins with all that falls short, from every file
Number = int | float | str
HEAD = "`make pictures` writes this page from [{name}.json](../figures/{name}.json); edit that file, not the page."


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

    def shown(self, line: tuple[str, ...]) -> list[str]:
        """Cells of a line: `=TABLE/ROW/COLUMN` is the paper's own figure, `@...` a figure of another table."""
        beside = " ".join((self.title, *self.head, *(cell for cell in line if not cell.startswith(("=", "@")))))
        return [paper().printed(cell[1:], beside) if cell.startswith("=") else _looked_up(cell) for cell in line]


class Topic(Model):
    """A file of figures."""

    title: str
    about: str = ""
    tables: tuple[Table, ...]


def topics() -> dict[str, Topic]:
    """All files of figures, by name."""
    return {path.stem: Topic.model_validate_json(path.read_text()) for path in sorted(FIGURES.glob("*.json"))}


def made() -> dict[str, Callable[[], str]]:
    """What makes each page, by its path."""
    return {f"{PAGES}/{path.stem}.md": partial(page, path.stem) for path in sorted(FIGURES.glob("*.json"))}


def page(name: str) -> str:
    """A page in Markdown."""
    topic = topics()[name]
    parts = [HEAD.format(name=name), f"# {topic.title}", topic.about]
    if name == RESULTS:
        parts += ["## What falls short", markdown(*columns(list(falls_short())))]
    for before, table in zip([None, *topic.tables], topic.tables, strict=False):
        if before is None or before.title != table.title:
            parts.append(f"## {table.title}")
        parts += [table.about, f"`{table.command}`" if table.command else ""]
        parts += [f"Measured at {table.commit}, release {table.release}."] if table.commit else []
        parts += [markdown(table.head, [table.shown(line) for line in table.cells])] if table.head else []
        parts += [markdown(*columns([table.printed(row) for row in table.rows]))] if table.rows else []
    return "\n\n".join(part for part in parts if part) + "\n"


def _looked_up(cell: str) -> str:
    """A cell, or a figure of another file: `@FILE->CLAIM` of a row, `@FILE->TITLE->FIRST CELL->COLUMN` of a table.

    Raises:
        KeyError: there is no such figure.
    """
    if not cell.startswith("@"):
        return cell
    name, *where = cell[1:].split("->")
    for table in topics()[name].tables:
        for row in table.rows if len(where) == 1 else ():
            if row.claim == where[0]:
                return f"{row.figure:g}" if isinstance(row.figure, float) else str(row.figure)
        for line in table.cells if where[0] == table.title else ():
            if line[0] == where[1]:
                return line[table.head.index(where[2])]
    raise KeyError(cell)


def falls_short() -> Iterator[Row]:
    """Every figure that misses its bar, named by its table."""
    for topic in topics().values():
        for table in topic.tables:
            for row in table.rows:
                if row.met is False:
                    yield row.model_copy(update={"claim": f"{table.title}: {row.claim}", "paper": None})


def columns(rows: Sequence[Row]) -> tuple[list[str], list[list[str]]]:
    """Heading and cells of the columns that any row fills."""
    names = [name for name in Row.model_fields if any(getattr(row, name) is not None for row in rows)]
    return names, [[_cell(name, getattr(row, name)) for name in names] for row in rows]


def _cell(name: str, value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, tuple):
        return f"{value[0]:g} to {value[1]:g}"
    if isinstance(value, bool):
        return "met" if value else "**missed**"
    text = str(value).replace("|", "\\|")
    return f"`{text}`" if name == "command" else text
