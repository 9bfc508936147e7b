"""docs/research/ is what docs/figures/ says, every figure names its command, and every command is one that exists."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

import pytest
from pydantic import ValidationError

from tests import ROOT
from tests.cell.commands.test_surface import command
from tests.docs.figures import FIGURES, PAGES, RESULTS, Row, columns, falls_short, page, topics

NAMES = sorted(path.stem for path in FIGURES.glob("*.json"))


@pytest.mark.parametrize("name", NAMES)
def test_a_page_is_what_its_figures_say(name: str) -> None:
    assert (ROOT / PAGES / f"{name}.md").read_text() == page(name), "make pictures"


def test_there_is_no_page_without_figures() -> None:
    assert {path.stem for path in (ROOT / PAGES).glob("*.md")} == set(NAMES)
    assert [path.name for path in (ROOT / PAGES).iterdir() if path.suffix != ".md"] == []


@pytest.mark.parametrize("name", NAMES)
def test_every_figure_names_the_command_that_measures_it(name: str) -> None:
    for table in topics()[name].tables:
        assert [row.claim for row in table.rows if not (row.command or table.command)] == [], table.title
        assert table.command or not table.head, table.title


def commands(value: Any) -> Iterator[str]:
    """All commands in figures and in what is said about them."""
    if isinstance(value, list):
        for one in value:
            yield from commands(one)
    elif isinstance(value, dict):
        for key, one in value.items():
            yield from [one] if key == "command" and one else commands(one)
    elif isinstance(value, str):
        yield from re.findall(r"`(cell [^`]+)`", value)


@pytest.fixture(scope="module")
def cell() -> Any:
    """The whole command line: it takes a second to make."""
    return command()


@pytest.mark.parametrize("name", NAMES)
def test_options_and_files_that_commands_name_exist(name: str, cell: Any) -> None:
    for line in commands(json.loads((FIGURES / f"{name}.json").read_text())):
        words = line.split()
        if words[0] == "cell":
            asked = cell
            for word in words[1:]:
                if word not in getattr(asked, "commands", {}):
                    break
                asked = asked.commands[word]
            known = {name for one in asked.params for name in (*one.opts, *one.secondary_opts)}
            assert {word for word in words if word.startswith("--")} <= known, line
        elif words[0] == "pytest":
            assert [word for word in words if word.startswith("tests/") and not (ROOT / word).exists()] == [], line


@pytest.mark.parametrize("name", NAMES)
def test_benchmarks_and_tests_that_commands_name_exist(name: str) -> None:
    text = (FIGURES / f"{name}.json").read_text()
    modules = set(re.findall(r"python -m (tests(?:\.\w+)+)", text))
    assert [module for module in modules if not (ROOT / f"{module.replace('.', '/')}.py").exists()] == []


@pytest.mark.parametrize("name", NAMES)
def test_tables_have_as_many_cells_as_columns(name: str) -> None:
    for table in topics()[name].tables:
        assert table.rows or table.cells, table.title
        assert {len(cells) for cells in table.cells} <= {len(table.head)}, table.title


def test_the_results_begin_with_all_that_falls_short() -> None:
    missed = [row for topic in topics().values() for table in topic.tables for row in table.rows if row.met is False]
    assert len(list(falls_short())) == len(missed) > 0
    first = page(RESULTS).split("\n## ")[1]
    assert first.startswith("What falls short")
    assert first.count("**missed**") == len(missed)


def test_a_bar_without_a_verdict_is_refused() -> None:
    with pytest.raises(ValidationError, match="a bar needs a verdict"):
        Row(claim="hands found", figure=0.9, bar=0.99)


def test_a_row_fills_only_the_columns_that_it_has() -> None:
    head, cells = columns([Row(claim="a", figure=0.5, interval=(0.4, 0.6)), Row(claim="b|c", figure="2 mm")])
    assert head == ["claim", "figure", "interval"]
    assert cells == [["a", "0.5", "0.4 to 0.6"], ["b\\|c", "2 mm", ""]]
