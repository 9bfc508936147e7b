"""JSON schemas of the YAML files, so that editors complete keys and mark mistakes."""

from __future__ import annotations

import json
from typing import Any

from cell.configuration import Configuration
from cell.files.model import Model
from cell.interfaces.faults import FaultTable
from cell.interfaces.product import Product
from sim.scene.look_range import LookFile
from sim.scene.person import Person

MARK = "made by cell lab schema; do not edit"


def modeline(path: str) -> str:
    """The comment by which editors find a file's schema."""
    return f"# yaml-language-server: $schema={path}"


def schemas() -> dict[str, str]:
    """Texts of the schemas by file name, one for each kind of YAML file."""
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
