"""`cell schema`: JSON schemas of the YAML files, so that editors complete keys and mark mistakes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from cell.commands.terminal import console
from cell.errors import InputError, Place, Problem

MARK = "made by cell schema; do not edit"


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


def modeline(path: str) -> str:
    """The comment by which editors find a file's schema."""
    return f"# yaml-language-server: $schema={path}"


def schemas() -> dict[str, str]:
    """Texts of the schemas by file name, one for each kind of YAML file."""
    from cell.configuration import Configuration
    from cell.files.model import Model
    from cell.interfaces.faults import FaultTable
    from cell.interfaces.product import Product
    from sim.scene.look_range import LookFile
    from sim.scene.person import Person

    look = _with_ranges(LookFile.model_json_schema())
    cell = Configuration.model_json_schema()
    inline = {key: value for key, value in look.items() if key != "$defs"}
    cell["$defs"] |= look["$defs"]
    cell["$defs"]["SimSettings"]["properties"]["look"]["anyOf"] = [{"type": "string"}, inline]
    others: dict[str, type[Model]] = {"products": Product, "faults": FaultTable, "person": Person}
    made = {"cell": cell, "look": look, **{name: model.model_json_schema() for name, model in others.items()}}
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "$comment": MARK}
    return {f"{name}.json": json.dumps({**head, **schema}, indent=2) + "\n" for name, schema in made.items()}


def _with_ranges(schema: Any) -> Any:
    """The schema of a look file, in which each single value may be a range [from, to]."""
    if isinstance(schema, list):
        return [_with_ranges(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    if schema.get("type") in ("number", "integer", "boolean"):
        return {"anyOf": [schema, {"type": "array", "items": schema, "minItems": 2, "maxItems": 2}]}
    return {key: value if key == "default" else _with_ranges(value) for key, value in schema.items()}


def _ours(path: Path) -> bool:
    try:
        return MARK in path.read_text()
    except (OSError, UnicodeDecodeError):
        return False
