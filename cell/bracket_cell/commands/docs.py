"""`cell docs`: the guides that came with the program, in the terminal; no network is needed."""

from __future__ import annotations

from difflib import get_close_matches
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markdown import Markdown

from bracket_ground.errors import InputError
from bracket_ground.files.files import read_text, shipped


def docs(
    page: Annotated[str | None, typer.Argument(help="One page, such as shift or configuration/bench.")] = None,
) -> None:
    """Read the guides: all of them by their titles, or one."""
    folder = shipped("bracket_cell", "docs")
    pages = {path.relative_to(folder).with_suffix("").as_posix(): path for path in sorted(folder.rglob("*.md"))}
    say = Console(emoji=False, highlight=False)
    if page is None:
        width = max(map(len, pages))
        for name, path in pages.items():
            say.print(f"{name:{width}}  {_title(path)}", markup=False, soft_wrap=True)
        say.print(f"{folder}: `cell docs PAGE` shows one", markup=False, soft_wrap=True)
        return
    known = {name.lower(): path for name, path in pages.items()}
    name = page.lower().removeprefix("docs/").removesuffix(".md")
    if name not in known:
        near = ", ".join(get_close_matches(name, known, 3))
        raise InputError(f"there is no page {page!r}{near and f', but {near}'}; `cell docs` lists all")
    say.print(Markdown(read_text(known[name])))


def _title(page: Path) -> str:
    """Its first heading."""
    lines = read_text(page).splitlines()
    return next((line.removeprefix("# ") for line in lines if line.startswith("# ")), "")
