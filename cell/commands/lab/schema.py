"""`cell lab schema`: JSON schemas of the YAML files, for editors."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cell.commands.init import modeline, write_schemas
from cell.commands.terminal import console


def schema(
    folder: Annotated[Path, typer.Argument(help="Folder for them; older schemas are replaced.")] = Path(
        "config/schema"
    ),
) -> None:
    """Write JSON schemas of all YAML files, for editors."""
    say = console()
    for path in write_schemas(folder.resolve()):
        say.print(f"{path}", highlight=False)
    say.print("first line of a YAML file, for editors with the YAML language server:", highlight=False)
    say.print(modeline(str(folder.resolve() / "cell.json")), highlight=False)
