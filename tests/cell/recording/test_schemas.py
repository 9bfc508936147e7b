"""Viewers read the schemas of every topic: the rules of Lichtblick's parser, which drops a topic that breaks one."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import jsonschema
import orjson
import pytest
from mcap.reader import make_reader

from bracket_cell.log.read.reader import Log
from bracket_cell.recording.json_schema import fields_of, with_nulls, without_nulls
from bracket_cell.recording.schemas import TOPICS, json_bytes, plain, schema
from bracket_ground.interfaces.perception import Action, BenchView, HandSample, HoleView

UNNAMED = {"/snapshot", "/edit", "/hook"}  # what they hold is named by the tree, the files and the monitor
LISTS_OF_LISTS = {"finished", "lies_on", "causes"}  # of a memory: no viewer reads a schema with them

PLAIN = {"boolean", "string", "number", "integer"}


def unread(fields: dict[str, Any]) -> list[str]:
    """Names of the properties that the parser cannot take."""
    bad = []
    for name, field in fields.get("properties", {}).items():
        kind = str(field.get("type"))
        if kind == "object":
            bad += unread(field)
        elif kind == "array":
            items = field.get("items", {})
            if items.get("type") == "object":
                bad += unread(items)
            elif items.get("type") not in PLAIN:
                bad.append(name)
        elif kind not in PLAIN:
            bad.append(name)
    return bad


@pytest.mark.parametrize("topic", TOPICS)
def test_a_viewer_reads_the_schema(topic: str) -> None:
    assert schema(topic)["type"] == "object"
    assert unread(schema(topic)) == []


def test_the_rules_refuse_what_viewers_refuse() -> None:
    assert unread({"properties": {"a": {"type": "array"}, "b": {"type": ["string", "null"]}, "c": {}}}) == [
        "a",
        "b",
        "c",
    ]


def unnamed(schema: dict[str, Any], value: Any) -> list[str]:
    """Keys of a message that its schema does not name, where it names any; lists of lists cannot be named."""
    if schema["type"] == "array":
        return [key for item in value for key in unnamed(schema["items"], item)]
    if schema["type"] != "object" or "properties" not in schema:
        return []
    named = schema["properties"]
    found = [key for key, item in value.items() if key not in named and not _rows(item)]
    return found + [deeper for key in value if key in named for deeper in unnamed(named[key], value[key])]


def _rows(item: Any) -> bool:
    return isinstance(item, list) and bool(item) and isinstance(item[0], list)


def test_schemas_hold_for_every_message_of_a_log_and_name_every_field(commission_log: Log) -> None:
    validators: dict[str, jsonschema.Draft202012Validator] = {}
    with commission_log.path.open("rb") as stream:
        for schema_record, channel, message in make_reader(stream).iter_messages():
            if channel.message_encoding != "json":
                continue
            assert schema_record is not None
            rules, content = json.loads(schema_record.data), json.loads(message.data)
            if channel.topic not in validators:
                jsonschema.Draft202012Validator.check_schema(rules)
                validators[channel.topic] = jsonschema.Draft202012Validator(rules)
            validators[channel.topic].validate(content)
            assert channel.topic in UNNAMED or set(unnamed(rules, content)) <= LISTS_OF_LISTS, channel.topic
    checked = set(validators)
    assert checked >= {
        "/tick",
        "/judgement",
        "/timing",
        "/observation",
        "/bench",
        "/parts",
        "/command",
        "/display",
    }


def test_what_is_none_is_left_out_and_comes_back() -> None:
    holes = {"p1": HoleView(None, 0.9, 1.0), "p2": HoleView("o1", 0.9, 1.0)}
    for hand in (None, HandSample(1.0, (0, 0, 9, 9), (0.1, 0.2), (0.1, 0.3))):
        view = plain(BenchView(3, 1.0, hand, holes, Action("idle", 0.9)))
        written = without_nulls(view)
        jsonschema.validate(written, {"type": "object", "properties": fields_of(BenchView)})
        assert "null" not in json.dumps(written)
        assert with_nulls(BenchView, written) == view


@dataclass
class Odd:
    """Fields of which viewers read two."""

    rows: tuple[tuple[float, ...], ...]
    either: int | str
    name: str | None
    points: tuple[float, ...]


def test_fields_that_viewers_cannot_read_are_left_unnamed() -> None:
    assert fields_of(Odd) == {"name": {"type": "string"}, "points": {"type": "array", "items": {"type": "number"}}}


def test_what_is_written_is_read_whatever_a_node_of_ones_own_notes() -> None:
    """An integer of 400 digits, or half a character, made a log that no command read."""
    odd = {"huge": 10**400, "large": -(2**70), "half": "a\ud800b", "small": 7}
    assert orjson.loads(json_bytes(odd)) == {"huge": str(10**400), "large": str(-(2**70)), "half": "a?b", "small": 7}
