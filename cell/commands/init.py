"""`cell init`: a folder with a configuration, a product, a tree and a test that run at once, and with schemas."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path
from typing import Annotated, Any

import typer

from cell.commands.terminal import console
from cell.configuration import Configuration
from cell.errors import InputError, Place, Problem
from cell.files.files import shipped, write_new
from cell.files.model import Model
from cell.interfaces.faults import FaultTable
from cell.interfaces.product import Product
from cell.interfaces.robot import RobotModel
from sim.scene.look_range import LookFile
from sim.scene.person import Person
from sim.scene.settings import SimSettings

MARK = "made by cell init --schemas; do not edit"
OURS = re.compile("made by cell [a-z -]*; do not edit")
SHIPPED = {
    "config": ("cell.yaml", "sim.yaml", "products.yaml", "products_steel.yaml"),
    "trees": ("ahead.xml", "algorithm1.xml", "assemble.xml", "clear_and_grasp.xml", "shift.xml", "shift_ahead.xml"),
}
OWN = ("README.md", "tests/test_assemble.py")


def write_schemas(folder: Path) -> list[Path]:
    """Write all schemas, over those that this program wrote; returns the files.

    Raises:
        InputError: another file has the name of one, or one cannot be written.
    """
    files = {folder / name: text for name, text in schema_texts().items()}
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


def schema_texts() -> dict[str, str]:
    """Texts of the schemas by file name, one for each kind of YAML file."""
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
        return OURS.search(path.read_text()) is not None
    except (OSError, UnicodeDecodeError):
        return False


def init(
    folder: Annotated[Path, typer.Argument(help="Folder to make; existing files are kept.")],
    schemas: Annotated[
        bool, typer.Option("--schemas", help="Only renew config/schema, which editors read; use it after an update.")
    ] = False,
) -> None:
    """Make a folder for a cell of your own: configuration, product, tree and test."""
    say = console()
    if schemas:
        for path in write_schemas(folder / "config" / "schema"):
            say.print(f"{path}", highlight=False)
        return
    files = new_cell()
    write_new(folder, files)
    for name in files:
        say.print(f"{folder / name}", highlight=False)
    say.print(f"next: cd {shlex.quote(str(folder))} && cell run", highlight=False)


def new_cell() -> dict[str, bytes]:
    """Contents by their names in the folder."""
    files = {f"{package}/{name}": shipped(package, name) for package, names in SHIPPED.items() for name in names}
    files |= {name: shipped("cell.commands", "new_cell", name) for name in OWN}
    contents = {name: file.read_bytes() for name, file in files.items()}
    for name in ("cell", "sim", "products"):
        first_line = f"{modeline(f'schema/{name}.json')}\n".encode()
        contents[f"config/{name}.yaml"] = first_line + contents[f"config/{name}.yaml"]
    return contents | {f"config/schema/{name}": text.encode() for name, text in schema_texts().items()}
