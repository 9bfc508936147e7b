"""`cell schema`: schemas of YAML files and tree files, from which editors complete and mark mistakes."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Annotated

import typer

from bracket_cell.commands.options import NamesOption, WithOption, always_loaded, registry_of, user_files
from bracket_cell.commands.terminal import console
from bracket_cell.configuration import Configuration
from bracket_cell.simulator import installed
from bracket_ground.errors import InputError, Place, Problem
from bracket_ground.files.model import Model
from bracket_ground.interfaces.faults import FaultTable
from bracket_ground.interfaces.gripper import Gripper
from bracket_ground.interfaces.product import Product
from bracket_ground.interfaces.robot import RobotModel
from btxml.files.compile.registry import Registry
from btxml.views.schema import tree_schema

MARK = "made by cell schema; do not edit"
OURS = re.compile("made by cell [a-z -]*; do not edit")


def schema(
    folder: Annotated[Path, typer.Argument(help="Folder for them; older schemas are replaced.")] = Path(
        "config/schema"
    ),
    config: NamesOption = None,
    own: WithOption = None,
) -> None:
    """Write schemas of all files that you edit, YAML and trees, for editors."""
    say = console()
    for path in write_schemas(folder.resolve(), registry_of(config, (*user_files(own)[0], *always_loaded()))):
        say.print(f"{path}", highlight=False)
    say.print(f"first line of a YAML file: {modeline(str(folder.resolve() / 'cell.json'))}", highlight=False)


def write_schemas(folder: Path, registry: Registry) -> list[Path]:
    """Write all schemas, over those that this program wrote; returns the files.

    Raises:
        InputError: another file has the name of one, or one cannot be written.
    """
    files = {folder / name: text for name, text in schema_texts(registry).items()}
    if foreign := [path for path in files if path.exists() and not _ours(path)]:
        raise InputError(
            *(Problem(Place(path), "was not written by this program", "name a folder") for path in foreign)
        )
    for path, text in files.items():
        try:
            folder.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        except OSError as error:
            raise InputError(Problem(Place(path), f"cannot be written: {error.strerror or error}")) from None
    return list(files)


def modeline(path: str) -> str:
    """The comment by which editors find a file's schema."""
    return f"# yaml-language-server: $schema={path}"


def schema_texts(registry: Registry) -> dict[str, str]:
    """Texts of the schemas by file name: one for each kind of YAML file, and one for tree files."""
    models: dict[str, type[Model]] = {"cell": Configuration, "products": Product, "faults": FaultTable}
    models |= {"robot": RobotModel, "gripper": Gripper}
    found = installed()
    made = {name: model.model_json_schema() for name, model in models.items()} | dict(found.schemas() if found else {})
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "$comment": MARK}
    texts = {f"{name}.json": json.dumps({**head, **schema}, indent=2) + "\n" for name, schema in made.items()}
    return texts | {"trees.xsd": tree_schema(registry, MARK)}


def _ours(path: Path) -> bool:
    try:
        return OURS.search(path.read_text()) is not None
    except (OSError, UnicodeDecodeError):
        return False
