"""`cell lab schema`: JSON schemas of the YAML files, for editors."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cell.commands.schema import MARK, modeline, schemas
from cell.commands.terminal import console
from cell.errors import InputError, Place, Problem


def schema(
    folder: Annotated[Path, typer.Argument(help="Where to write them; schemas of before are replaced.")] = Path(
        "config/schema"
    ),
) -> None:
    """Write JSON schemas of all YAML files, for editors."""
    files = schemas()
    folder = folder.resolve()
    foreign = [folder / name for name in files if (folder / name).exists() and not _ours(folder / name)]
    if foreign:
        raise InputError(*(Problem(Place(path), "is no schema of this program", "name a folder") for path in foreign))
    say = console()
    for name, text in files.items():
        try:
            folder.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(text)
        except OSError as error:
            raise InputError(Problem(Place(folder / name), f"cannot be written: {error.strerror or error}")) from None
        say.print(f"{folder / name}", highlight=False)
    say.print("first line of a YAML file, for editors with the YAML language server:", highlight=False)
    say.print(f"{modeline(str(folder / 'cell.json'))}", highlight=False)


def _ours(path: Path) -> bool:
    try:
        return MARK in path.read_text()
    except (OSError, UnicodeDecodeError):
        return False
