"""Pages in docs/ lead somewhere: links and file names in them exist, and lines are short."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace

import pytest

from bracket_sim.scene.person import PERSONS
from tests import ROOT
from tests.cell.commands.test_surface import whole

DOCS = ROOT / "docs"
RESEARCH = sorted((DOCS / "research").glob("*.md"))
GENERATED = [DOCS / "configuration.md", *RESEARCH]
PAGES = [ROOT / "README.md", *sorted(DOCS.glob("*.md"))]
ENTRY = re.compile(r"- (?:[^:\n]+: )?([\w/*-]+\.md)$", re.MULTILINE)
LINK = re.compile(r"\]\(([^)#]+)(?:#[^)]*)?\)")
FILE = re.compile(r"`((?:ground|engine|cell|trees|skills|learned|sim|lab|config|tests|docs)/[\w/.]+\.\w+)`")
TYPED = re.compile(r"(?:^    |^|`)(?:CLONE/)?cell ([a-z][^`\n]*)", re.MULTILINE)
MOST_WORDS, MOST_WORDS_IN_ALL = 1300, 19_000
OWN = ("config/cell.yaml", "trees/mine.xml", "tests/trees/test_patient.py")  # of the reader


@pytest.mark.parametrize("page", [*PAGES, *RESEARCH], ids=lambda page: f"{page.parent.name}/{page.name}")
def test_links_and_files_that_a_page_names_exist(page: Path) -> None:
    text = page.read_text()
    links = [link for link in LINK.findall(text) if "://" not in link]
    assert [link for link in links if not (page.parent / link).exists()] == []
    assert [name for name in FILE.findall(text) if name not in OWN and not (ROOT / name).exists()] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_lines_are_wrapped(page: Path) -> None:
    code = False
    for number, line in enumerate(page.read_text().splitlines(), 1):
        code ^= line.startswith("```")
        if not code and not line.startswith(("|", "![", "    ")) and page not in GENERATED:
            assert len(line) <= 120, f"{page.name}:{number}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_no_page_is_longer_than_a_sitting(page: Path) -> None:
    assert len(page.read_text().split()) <= MOST_WORDS


def test_all_pages_together_are_read_in_an_afternoon() -> None:
    assert sum(len(page.read_text().split()) for page in PAGES if page not in GENERATED) <= MOST_WORDS_IN_ALL


def test_every_page_is_in_the_nav_of_the_site() -> None:
    nav = (ROOT / "mkdocs.yml").read_text()
    names = {path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md")}
    listed = {path.relative_to(DOCS).as_posix() for entry in ENTRY.findall(nav) for path in DOCS.glob(entry)}
    assert names - listed == set()


def test_commands_and_options_that_pages_show_exist() -> None:
    """In blocks, in code between words, and over the end of a line."""
    shown = [
        (page.name, said)
        for page in [*PAGES, *RESEARCH, ROOT / "editor" / "README.md"]
        for said in TYPED.findall(re.sub(r"#.*|(?<=[^`\n])\n(?! )", " ", page.read_text()))
    ]
    assert len(shown) > 150
    assert [f"{page}: cell {said}" for page, said in shown if not _exists(said)] == []


def _exists(said: str) -> bool:
    """Whether a command line names a command, and options of it."""
    command = whole()
    words = said.split()
    while words and words[0] in getattr(command, "commands", {}):
        command = command.commands[words.pop(0)]
    legal = {name for param in command.params for name in [*param.opts, *param.secondary_opts]} | {"--version"}
    return all(word.partition("=")[0] in legal for word in words if word.startswith("--"))


def test_every_person_is_on_its_page() -> None:
    page = (DOCS / "people.md").read_text()
    names = {path.stem for path in (ROOT / "config" / "people").glob("*.yaml")}
    assert [name for name in sorted(names | set(PERSONS)) if not re.search(rf"\b{name}\b", page)] == []


def test_what_leaves_this_machine_names_every_key_and_target_that_reaches_beyond() -> None:
    page = (DOCS / "what-leaves.md").read_text()
    keys = set(
        re.findall(r"^\| `(host|url|address|channel|at)` \|", (DOCS / "configuration/devices.md").read_text(), re.M)
    )
    assert keys >= {"host", "url", "channel", "at"}
    assert [key for key in keys if not re.search(rf"`devices\.\w+\.{key}`", page)] == []
    recipes = re.findall(r"^([a-z]+):[^\n=]*\n((?:\t[^\n]*\n)+)", (ROOT / "Makefile").read_text(), re.M)
    fetching = [target for target, recipe in recipes if re.search(r"npm |uv pip|lab hands", recipe)]
    assert len(fetching) >= 4
    assert [target for target in fetching if f"`make {target}`" not in page] == []
    options = re.findall(r"^\| `cell run (--\w+)`", (DOCS / "SECURITY.md").read_text(), re.M)
    assert [option for option in options if f"`{option}`" not in page] == []


def test_the_site_lists_its_pages_for_language_models() -> None:
    site = pytest.importorskip("tests.docs.site", reason="mkdocs comes by `make site`")
    nav = [{"Start": [{"Home": "README.md"}, {"More": [{"Logs": "logs.md"}, "reference/btxml.md"]}]}]
    text = site.overview(SimpleNamespace(site_name="Cell", site_description="A controller", nav=nav))
    assert text.splitlines()[:3] == ["# Cell", "", "> A controller"]
    assert text.splitlines()[6:] == [
        "- [Home](index.html)",
        "- [Logs](logs.html)",
        "- [btxml](reference/btxml.html)",
    ]
