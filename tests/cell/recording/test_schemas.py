"""Viewers read the schemas of every topic: the rules of Lichtblick's parser, which drops a topic that breaks one."""

from __future__ import annotations

from typing import Any

import pytest

from cell.recording.schemas import TOPICS, schema

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
