"""docs/research/ is what docs/figures/ says, every figure names its command, and every command is one that exists."""

from __future__ import annotations

import json
import re
import subprocess
from collections.abc import Iterator
from typing import Any

import pytest
from pydantic import ValidationError

from bracket_ground.errors import InputError
from bracket_lab.evaluations.figures import FIGURES, Row, Table, topics
from tests import ROOT
from tests.cell.commands.test_surface import command
from tests.docs.figures import PAGES, RESULTS, columns, falls_short, page, shown

SHOWN_RELEASES = 2  # whose figures stand in the pages: the one in the making and the last
PLACE = {"interval": (0.4, 0.6), "n": 9, "command": "cell", "commit": "a", "release": "1"}
NAMES = sorted(path.stem for path in FIGURES.glob("*.json"))


@pytest.mark.parametrize("name", NAMES)
def test_a_page_is_what_its_figures_say(name: str) -> None:
    assert (ROOT / PAGES / f"{name}.md").read_text() == page(name), "make pictures"


def test_there_is_no_page_without_figures() -> None:
    assert {path.stem for path in (ROOT / PAGES).glob("*.md")} == set(NAMES)
    assert [path.name for path in (ROOT / PAGES).iterdir() if path.suffix != ".md"] == []


@pytest.mark.parametrize("name", NAMES)
def test_every_table_names_the_command_that_measures_it(name: str) -> None:
    for table in topics()[name].tables:
        assert table.command or not any("@" in cell for line in table.cells for cell in line), table.title


def releases() -> list[str]:
    """Of the changelog, the newest first; the one in the making before them."""
    made = re.findall(r"^## (\d+\.\d+\.\d+)", (ROOT / "CHANGELOG.md").read_text(), re.M)
    return list(dict.fromkeys([version_of((ROOT / "cell/pyproject.toml").read_text()), *made]))


def version_of(text: str) -> str:
    """The version that a project file names; empty where it names none."""
    found = re.search(r'^version = "(.*)"', text, re.M)
    return found[1] if found else ""


@pytest.mark.parametrize("name", NAMES)
def test_no_figure_is_older_than_the_last_releases(name: str) -> None:
    latest = releases()[:SHOWN_RELEASES]
    for table in topics()[name].tables:
        assert [row.claim for row in table.rows if row.release not in latest] == []
        assert not table.cells or table.release in latest, table.title


@pytest.mark.parametrize("name", NAMES)
def test_a_commit_is_of_the_release_that_a_figure_names(name: str) -> None:
    if not (ROOT / ".git").exists():
        pytest.skip("without its history")
    tables = topics()[name].tables
    found = {(row.commit, row.release) for table in tables for row in table.rows}
    found |= {(table.commit, table.release or "") for table in tables if table.commit}
    for commit, release in found:
        files = (git("show", f"{commit}:{file}") for file in ("pyproject.toml", "cell/pyproject.toml"))
        assert release in map(version_of, files), commit


def git(*words: str) -> str:
    """What git says; empty where it fails."""
    return subprocess.run(["git", "-C", str(ROOT), *words], capture_output=True, text=True, check=False).stdout


def test_a_figure_beside_the_papers_is_of_the_same_conditions() -> None:
    measured = {"figure": 0.976, "interval": (0.95, 0.99), "n": 250, "command": "cell", "commit": "a", "release": "1"}
    row = Row(claim="one image, 3 parts", paper="Table 3/one image/3 parts", **measured)  # type: ignore[arg-type]
    assert Table(title="Table 3").printed(row).paper == ".962"
    for wrong in ("Table 3/executed/3 parts", "Table 3/one image/4 parts", "Table 4/VMRN/IA", "Table 9/x/y"):
        with pytest.raises(InputError, match=wrong.split("/")[0]):
            Table(title="Table 3").printed(row.model_copy(update={"paper": wrong}))
    with pytest.raises(InputError, match="does not say executed"):
        shown(Table(title="Table 3", head=("", "paper")), ("one image, 3 parts", "=Table 3/executed/3 parts"))


def test_every_printed_figure_in_a_page_comes_from_the_file_of_the_paper() -> None:
    """No column of the paper holds a number that somebody typed."""
    for topic in topics().values():
        for table in topic.tables:
            for column in (
                number for number, name in enumerate(table.head) if "paper" in name and name != "paper's IA"
            ):
                typed = [line[column] for line in table.cells if re.fullmatch(r"[\d.+ /-]*\d", line[column])]
                assert typed == [], table.title


@pytest.mark.parametrize("name", NAMES)
def test_a_time_is_of_twenty_seeds_at_least(name: str) -> None:
    for table in topics()[name].tables:
        for row in table.rows:
            if re.search(r"\btime\b.*(\[s\]|\[%\])", row.claim) and "processor" not in row.claim:
                assert int(re.findall(r"\d+", str(row.n))[0]) >= 20, row.claim


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
            known = {name for param in asked.params for name in (*param.opts, *param.secondary_opts)}
            assert {word for word in words if word.startswith("--")} <= known, line
        elif words[0] == "pytest":
            assert [word for word in words if word.startswith("tests/") and not (ROOT / word).exists()] == [], line


@pytest.mark.parametrize("name", NAMES)
def test_benchmarks_trees_and_configurations_that_commands_name_exist(name: str) -> None:
    text = (FIGURES / f"{name}.json").read_text()
    modules = {f"{name.replace('.', '/')}.py" for name in re.findall(r"python -m (tests(?:\.\w+)+)", text)}
    files = set(re.findall(r"\b(?:trees|config)/[\w/]+\.(?:xml|yaml)", text))
    assert [name for name in modules | files if not (ROOT / name).exists()] == []


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
        Row(claim="hands found", figure=0.9, bar=0.99, **PLACE)  # type: ignore[arg-type]


def test_a_row_fills_only_the_columns_that_it_has() -> None:
    other = {**PLACE, "interval": "unknown"}
    head, cells = columns([Row(claim="a", figure=0.5, **PLACE), Row(claim="b|c", figure="2 mm", **other)])  # type: ignore[arg-type]
    assert head == ["claim", "figure", "interval", "n", "command", "commit", "release"]
    assert [line[:3] for line in cells] == [["a", "0.5", "0.4 to 0.6"], ["b\\|c", "2 mm", "unknown"]]
