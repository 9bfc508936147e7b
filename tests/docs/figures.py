"""docs/research/*.md: a page of tables for each JSON file of figures in docs/figures. `make pictures` writes them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial

from bracket_lab.evaluations.figures import FIGURES, Row, Table, paper, topics

PAGES = "docs/research"
RESULTS = "results"  # its page begins with all that falls short, from every file
HEAD = "`make pictures` writes this page from [{name}.json](../figures/{name}.json); edit that file, not the page."


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
        parts += [markdown(table.head, [shown(table, line) for line in table.cells])] if table.head else []
        parts += [markdown(*columns([table.printed(row) for row in table.rows]))] if table.rows else []
    return "\n\n".join(part for part in parts if part) + "\n"


def shown(table: Table, line: tuple[str, ...]) -> list[str]:
    """Cells of a line: `=TABLE/ROW/COLUMN` is the paper's own figure, `@...` a figure of another table."""
    beside = " ".join((table.title, *table.head, *(cell for cell in line if not cell.startswith(("=", "@")))))
    return [paper().printed(cell[1:], beside) if cell.startswith("=") else _looked_up(cell) for cell in line]


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


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
