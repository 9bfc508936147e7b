"""`cell schema`: schemas of YAML files and tree files, from which editors complete and mark mistakes."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Annotated, Any

import typer

from cell.commands.options import NamesOption, WithOption, always_loaded, own_files, registry_of
from cell.commands.terminal import console
from cell.configuration import Configuration
from cell.errors import InputError, Place, Problem
from cell.files.model import Model
from cell.interfaces.faults import FaultTable
from cell.interfaces.product import Product
from cell.interfaces.robot import RobotModel
from sim.scene.look_range import LookFile
from sim.scene.person import Person
from sim.scene.settings import SimSettings
from trees.files.build.registry import Registry
from trees.views.schema import tree_schema

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
    for path in write_schemas(folder.resolve(), registry_of(config, (*own_files(own)[0], *always_loaded()))):
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
    look = _with_ranges(LookFile.model_json_schema())
    sim = SimSettings.model_json_schema()
    inline = {key: value for key, value in look.items() if key != "$defs"}
    sim["$defs"] |= look["$defs"]
    sim["properties"]["look"]["anyOf"] = [{"type": "string"}, inline]
    others: dict[str, type[Model]] = {
        "cell": Configuration,
        "products": Product,
        "faults": FaultTable,
        "person": Person,
        "robot": RobotModel,
    }
    made = {"look": look, "sim": sim, **{name: model.model_json_schema() for name, model in others.items()}}
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "$comment": MARK}
    texts = {f"{name}.json": json.dumps({**head, **schema}, indent=2) + "\n" for name, schema in made.items()}
    return texts | {"trees.xsd": tree_schema(registry, MARK)}


def _with_ranges(schema: Any) -> Any:
    """The schema of a look file, in which each single value may be a range [from, to]."""
    if isinstance(schema, list):
        return [_with_ranges(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    if schema.get("type") in ("number", "integer", "boolean") or "enum" in schema:
        return {"anyOf": [schema, {"type": "array", "items": schema, "minItems": 2, "maxItems": 2}]}
    return {key: value if key == "default" else _with_ranges(value) for key, value in schema.items()}


def _ours(path: Path) -> bool:
    try:
        return OURS.search(path.read_text()) is not None
    except (OSError, UnicodeDecodeError):
        return False
