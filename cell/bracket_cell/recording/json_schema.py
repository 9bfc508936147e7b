"""JSON schemas of dataclasses, in the plain form that viewers read: no references, no alternatives, no null.

Lichtblick drops a topic whose schema has a list of lists or a choice of types. Such a field is left unnamed, which a
schema allows. A field that is None is not written (`without_nulls`), so a schema names the other type alone.
"""

from __future__ import annotations

import dataclasses
import types
import typing
from collections.abc import Mapping, Sequence
from enum import Enum
from functools import cache
from typing import Any

from pydantic_core import CoreSchema, core_schema

Schema = dict[str, Any]

NUMBER: Schema = {"type": "number"}
INTEGER: Schema = {"type": "integer"}
TEXT: Schema = {"type": "string"}
FLAG: Schema = {"type": "boolean"}
OBJECT: Schema = {"type": "object"}
_NOT_FINITE = core_schema.literal_schema(["nan", "inf", "-inf"])  # JSON has no word for them
_PLAIN: Mapping[str, CoreSchema] = {
    "number": core_schema.union_schema(
        [core_schema.float_schema(strict=True), _NOT_FINITE],
        custom_error_type="number", custom_error_message="no number",
    ),
    "integer": core_schema.int_schema(strict=True), "string": core_schema.str_schema(strict=True),
    "boolean": core_schema.bool_schema(strict=True), "object": core_schema.dict_schema(),
}  # fmt: skip


def checked(schema: Schema) -> CoreSchema:
    """The same for pydantic, which refuses data of other types; what it does not name, or is None in it, may be."""
    found = _PLAIN.get(schema["type"])
    if found is None:
        found = core_schema.list_schema(core_schema.nullable_schema(checked(schema["items"])), strict=True)
    elif named := schema.get("properties"):
        kinds = {name: checked(of) for name, of in named.items()}
        fields = {name: core_schema.typed_dict_field(kind, required=False) for name, kind in kinds.items()}
        found = core_schema.typed_dict_schema(fields, extra_behavior="allow")
    return found


def array(items: Schema) -> Schema:
    """A list of things of one kind."""
    return {"type": "array", "items": items}


def fields_of(kind: type) -> dict[str, Schema]:
    """Schemas of a dataclass's fields by name, of those that a viewer can read."""
    hints = _hints(kind)
    found = {field.name: _schema(hints[field.name]) for field in dataclasses.fields(kind)}
    return {name: schema for name, schema in found.items() if schema is not None}


def record(kind: type) -> Schema:
    """Schema of a dataclass."""
    return {"type": "object", "properties": fields_of(kind)}


def without_nulls(value: Any) -> Any:
    """Plain data without the entries of mappings that hold nothing, at any depth."""
    if isinstance(value, dict):
        return {key: without_nulls(item) for key, item in value.items() if item is not None}
    if isinstance(value, list) and value and isinstance(value[0], dict | list):
        return value if _is_table(value) else [without_nulls(item) for item in value]
    return value


def with_nulls(kind: Any, value: Any) -> Any:
    """What `without_nulls` left out of a dataclass's plain data is there again, at any depth."""
    if value is None:
        return None
    if dataclasses.is_dataclass(kind) and isinstance(value, dict):
        hints = _hints(typing.cast("type", kind))
        optional = (name for name, hint in hints.items() if types.NoneType in typing.get_args(hint))
        missing = dict.fromkeys(name for name in optional if name not in value)
        return {**missing, **{key: with_nulls(hints.get(key), item) for key, item in value.items()}}
    kind = _bare(kind)
    if dataclasses.is_dataclass(kind):
        return with_nulls(kind, value) if isinstance(value, dict) else value  # who reads it says that it is none
    arguments = typing.get_args(kind)
    if isinstance(value, dict) and len(arguments) == 2:
        return {key: with_nulls(arguments[1], item) for key, item in value.items()}
    if isinstance(value, list) and arguments and dataclasses.is_dataclass(arguments[0]):
        return [with_nulls(arguments[0], item) for item in value]
    return value


def _schema(hint: Any) -> Schema | None:
    """None for what a viewer cannot read."""
    hint = _bare(hint)
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin is typing.Literal:
        return TEXT
    if origin is not None and issubclass(origin, Mapping):
        return OBJECT
    if origin is not None and issubclass(origin, Sequence):
        items = _schema(arguments[0])
        return None if items is None or items["type"] == "array" else array(items)
    if not isinstance(hint, type):
        return None
    if dataclasses.is_dataclass(hint):
        return record(hint)
    for kind, schema in ((Enum, TEXT), (bool, FLAG), (int, INTEGER), (float, NUMBER), (str, TEXT), (Mapping, OBJECT)):
        if issubclass(hint, kind):
            return schema
    return None


def _bare(hint: Any) -> Any:
    """X of `X | None`; another choice of types as it is."""
    if isinstance(hint, types.UnionType) or typing.get_origin(hint) is typing.Union:
        kinds = [kind for kind in typing.get_args(hint) if kind is not types.NoneType]
        return kinds[0] if len(kinds) == 1 else hint
    return hint


def _is_table(value: list[Any]) -> bool:
    """Rows of numbers hold nothing that could be left out."""
    return isinstance(value[0], list) and (not value[0] or not isinstance(value[0][0], dict | list))


@cache
def _hints(kind: type) -> dict[str, Any]:
    return typing.get_type_hints(kind)
