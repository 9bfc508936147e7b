"""docs/configuration.md and its pages: every key of every YAML file, from the schemas of the models that read them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache, partial
from itertools import groupby
from typing import Any

import orjson

from bracket_cell.configuration import Configuration
from bracket_ground.files.model import Model
from bracket_ground.interfaces.faults import FaultTable
from bracket_ground.interfaces.gripper import Gripper
from bracket_ground.interfaces.product import Product
from bracket_ground.interfaces.robot import RobotModel
from bracket_sim.scene.look_range import LookFile
from bracket_sim.scene.person import Person
from bracket_sim.scene.settings import SimSettings

FILES: dict[str, type[Model]] = {
    "config/cell.yaml": Configuration,
    "config/sim.yaml": SimSettings,
    "config/robots/ur10.yaml": RobotModel,
    "config/grippers/2f85.yaml": Gripper,
    "config/products.yaml": Product,
    "config/faults.yaml": FaultTable,
    "config/looks/varied.yaml": LookFile,
    "A person's file, for `cell lab run --person FILE`": Person,
}
INDEX, FOLDER = "docs/configuration.md", "docs/configuration"
DIVIDED = "config/cell.yaml"  # a page a section
NAMES = {
    "config/robots/ur10.yaml": "robot",
    "config/grippers/2f85.yaml": "gripper",
    "config/looks/varied.yaml": "look",
    "A person's file, for `cell lab run --person FILE`": "person",
}
UNITS = {
    "_nm_s_rad": "N m s/rad", "_nm_rad": "N m/rad", "_nm": "N m", "_n_m": "N/m", "_kg_m2": "kg m²", "_kg_m_s": "kg m/s",
    "_kpa": "kPa",
    "_rad_s3": "rad/s³", "_rad_s2": "rad/s²", "_rad_s": "rad/s", "_m_s3": "m/s³", "_m_s2": "m/s²", "_m_s": "m/s",
    "_rad": "rad", "_mm": "mm", "_m2": "m²", "_m": "m", "_ms": "ms", "_s": "s", "_hz": "Hz", "_px": "px", "_kg": "kg",
    "_n": "N", "_mb": "MB", "_rgb": "0 to 1 each", "bitrate": "bit/s",
}  # fmt: skip
BOUNDS = {"exclusiveMinimum": "> {}", "minimum": "≥ {}", "exclusiveMaximum": "< {}", "maximum": "≤ {}"}
HEAD = """# Every key of the configuration

`make pictures` writes these pages from the models that read the files; edit their docstrings, not the pages.
[bench.md](bench.md) and [product.md](product.md) are the guides. A key without a default must stand in the file.
Unknown keys and values out of range are refused before anything moves, with file, line and column. `cell schema`
writes the same as JSON schemas, with which an editor completes and checks the files while you type.
"""


@dataclass
class Section:
    """A model in the schema and the places in the file where it stands."""

    schema: dict[str, Any]
    paths: list[str] = field(default_factory=list)


@cache
def pages() -> dict[str, str]:
    """Markdown by the page's path: the index first, then a page a file, of the cell's own file a page a section."""
    index, made = [HEAD], dict[str, str]()
    for file, model in FILES.items():
        schema = model.model_json_schema()
        index += [f"## {file}", schema["description"], ""]
        for place, group in groupby(sections(schema), partial(_page, file)):
            found = list(group)
            name = place or NAMES.get(file, file.rpartition("/")[2].removesuffix(".yaml"))
            path = f"{FOLDER}/{name}.md"
            lines = [f"# {name}", f"{file}: {found[0].schema['description']}", ""]
            for section in found:
                lines += _section(section, schema, place)
            assert path not in made, path
            made[path] = "\n".join(lines).rstrip() + "\n"
            index += [f"### [{name}]({path.removeprefix('docs/')})", ", ".join(_keys(found[0])), ""]
    return {INDEX: "\n".join(index).rstrip() + "\n", **made}


def sections(schema: dict[str, Any]) -> list[Section]:
    """The file's models, from the outside inwards; one that stands in several places comes once."""
    found: dict[str, Section] = {}
    waiting = [("", schema)]
    while waiting:
        path, model = waiting.pop()
        known = found.setdefault(model["title"] + model.get("description", ""), Section(model))
        known.paths.append(path)
        inner = [
            (f"{path}.{key}".lstrip(".") + step, schema["$defs"][name])
            for key, value in model["properties"].items()
            for step, name in _references(value)
        ]
        waiting += reversed(inner)
    return list(found.values())


def undocumented(schema: dict[str, Any]) -> list[str]:
    """Keys without a meaning."""
    return [
        f"{section.paths[0]}.{key}".lstrip(".")
        for section in sections(schema)
        for key, value in section.schema["properties"].items()
        if not _meaning(value, schema)
    ]


def _page(file: str, section: Section) -> str:
    """The section of the outermost level that a page is about; "" for the whole file."""
    return section.paths[0].partition(".")[0] if file == DIVIDED else ""


def _keys(section: Section) -> Iterator[str]:
    yield from (f"`{key}`" for key in section.schema["properties"])


def _section(section: Section, schema: dict[str, Any], place: str) -> Iterator[str]:
    if section.paths[0] != place:
        yield "## " + ", ".join(f"`{path}`" for path in section.paths)
        yield section.schema["description"]
        yield ""
    yield "| key | type | default | unit, range | meaning |"
    yield "|---|---|---|---|---|"
    required = section.schema.get("required") or section.schema.get("anyOf", [{}])[0].get("required", [])
    for key, value in section.schema["properties"].items():
        default = "" if key in required else _default(value)
        cells = [f"`{key}`", _type(value), default, _range(key, value), _meaning(value, schema)]
        yield "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
    yield ""


def _references(value: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """(what follows the key in a path, name of the model) of all models below a key."""
    if "$ref" in value:
        yield "", value["$ref"].rpartition("/")[2]
    for option in (*value.get("anyOf", []), *value.get("oneOf", [])):
        yield from _references(option)
    if isinstance(inner := value.get("additionalProperties"), dict):
        yield from ((f".*{step}", name) for step, name in _references(inner))
    if isinstance(inner := value.get("items"), dict):
        yield from ((f"[]{step}", name) for step, name in _references(inner))
    for item in value.get("prefixItems", [])[:1]:
        yield from ((f"[]{step}", name) for step, name in _references(item))


def _meaning(value: dict[str, Any], schema: dict[str, Any]) -> str:
    """What the model says about the key, or what the section itself is."""
    models = [schema["$defs"][name] for _, name in _references(value)]
    return str(value.get("description") or next((model["description"] for model in models), ""))


def _type(value: dict[str, Any]) -> str:
    if "$ref" in value or "oneOf" in value:
        return "section"
    if "anyOf" in value:
        return " or ".join(_type(option) for option in value["anyOf"])
    if "const" in value or "enum" in value:
        return " or ".join(f"`{option}`" for option in value.get("enum", [value.get("const")]))
    if value.get("type") == "array" and "prefixItems" in value:
        return f"list of {len(value['prefixItems'])} {_type(value['prefixItems'][0])}s"
    if value.get("type") == "array":
        return f"list of {_type(value['items'])}s"
    if value.get("type") == "object" and "additionalProperties" not in value:
        return "section"
    if value.get("type") == "object":
        return f"{_type(value['additionalProperties'])} by name"
    if value.get("format") in ("path", "file-path"):
        return "path"
    names = {
        "number": "number",
        "integer": "whole number",
        "string": "text",
        "boolean": "true or false",
        "null": "null",
    }
    return names[value["type"]]


def _default(value: dict[str, Any]) -> str:
    default = value.get("default")
    first = default[0] if isinstance(default, list) and default else default
    return "" if isinstance(first, dict) else f"`{orjson.dumps(default).decode().replace(',', ', ')}`"


def _range(key: str, value: dict[str, Any]) -> str:
    """The key's unit, as declared or from its name, and its bounds."""
    ending = next((ending for ending in UNITS if key.endswith(ending)), None)
    unit = [value["unit"]] if "unit" in value else [UNITS[ending]] if ending else []
    options = [value, *value.get("anyOf", [])]
    bounds = [text.format(f"{option[name]:g}") for option in options for name, text in BOUNDS.items() if name in option]
    pattern = [f"matches `{value['pattern']}`"] if "pattern" in value else []
    return ", ".join([*unit, *bounds, *pattern])
