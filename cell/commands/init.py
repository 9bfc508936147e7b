"""`cell init`: a folder with a configuration, a product, a tree and a test that run at once."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import typer

from cell.commands.schema import modeline, schemas
from cell.commands.terminal import console
from cell.interfaces.errors import InputError, Place, Problem
from cell.interfaces.files import shipped

SHIPPED = {
    "config": ("cell.yaml", "products.yaml", "products_steel.yaml"),
    "trees": ("ahead.xml", "assemble.xml", "clear_and_grasp.xml", "shift.xml", "shift_ahead.xml"),
}
OWN = ("README.md", "tests/test_assemble.py")


def init(folder: Annotated[Path, typer.Argument(help="Folder to make; files that are there are kept.")]) -> None:
    """Make a folder for a cell of your own: configuration, product, tree and test."""
    files = new_cell()
    write_new(folder, files)
    say = console()
    for name in files:
        say.print(f"{folder / name}", highlight=False)
    say.print(f"next: cd {shlex.quote(str(folder))} && cell run", highlight=False)


def new_cell() -> dict[str, bytes]:
    """Contents by their names in the folder."""
    files = {f"{package}/{name}": shipped(package, name) for package, names in SHIPPED.items() for name in names}
    files |= {name: shipped("cell.commands", "new_cell", name) for name in OWN}
    contents = {name: file.read_bytes() for name, file in files.items()}
    for name in ("cell", "products"):
        first_line = f"{modeline(f'schema/{name}.json')}\n".encode()
        contents[f"config/{name}.yaml"] = first_line + contents[f"config/{name}.yaml"]
    return contents | {f"config/schema/{name}": text.encode() for name, text in schemas().items()}


def write_new(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write files into a folder where none of them is.

    Raises:
        InputError: one of them is there already, or the folder cannot be written to; nothing new is left there.
    """
    paths = [folder / name for name in files]
    taken = [path for path in paths if path.exists() or path.is_symlink()]
    taken += [
        path for path in sorted({folder, *(path.parent for path in paths)}) if path.exists() and not path.is_dir()
    ]
    if taken:
        raise InputError(*(Problem(Place(path), "is there already", "choose another name") for path in taken))
    begun: list[Path] = []  # folders and files that were not there
    path = folder
    try:
        for name, content in files.items():
            path = folder / name
            _make_folder(path.parent, begun)
            with path.open("xb") as file:
                begun.append(path)
                file.write(content)
    except OSError as error:
        for one in reversed(begun):
            one.rmdir() if one.is_dir() else one.unlink()
        raise InputError(Problem(Place(path), f"cannot be written: {error.strerror or error}")) from None


def _make_folder(folder: Path, begun: list[Path]) -> None:
    missing = [one for one in (folder, *folder.parents) if not one.exists()]
    for one in reversed(missing):
        one.mkdir()
        begun.append(one)
