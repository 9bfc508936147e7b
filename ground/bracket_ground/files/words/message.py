"""Messages as data: an id, which is the English text with names in braces, and the values of these names."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from string import Formatter
from typing import Any

SPEC = re.compile(r"\{(\w+):[^{}]*\}")


class Message(str):
    """Words for people, as data: where a text is expected it is the English one, a catalogue knows others.

    Attributes:
        id: the English text with {names}; the key of every catalogue.
        values: what stands for the names; messages among them are translated, too.

    A format as in {probability:.2f} is applied at once: the id is without it, and other programs need not know of it.

    Example:
        Message("bringing {part} to {position}", part="o1", position="p3")
    """

    id: str
    values: Mapping[str, Any]

    def __new__(cls, id: str, /, **values: Any) -> Message:
        if values:
            values = {name: f"{values[name]:{spec}}" if spec else values[name] for name, spec in _fields(id)}
            id = SPEC.sub(r"{\1}", id)
        made = super().__new__(cls, id.format(**values) if values else id)
        made.id, made.values = id, values
        return made

    def __reduce__(self) -> tuple[Any, ...]:
        return _made, (self.id, dict(self.values))


def listed(messages: list[str], mark: str = "; ") -> str:
    """Several messages as one, joined by a mark."""
    joined, *rest = messages or [""]
    for message in rest:
        joined = Message(f"{{first}}{mark}{{second}}", first=joined, second=message)
    return joined


def data_of(text: str | None) -> Any:
    """A message as plain data, [id, values], for another program that has a catalogue; other texts as they are."""
    if not isinstance(text, Message) or not text.values:
        return text
    return [text.id, {name: data_of(value) if isinstance(value, str) else value for name, value in text.values.items()}]


def _made(id: str, values: Mapping[str, Any]) -> Message:
    return Message(id, **values)


def _fields(template: str) -> Iterator[tuple[str, str]]:
    """Names in a template, each with its format."""
    return ((name, spec or "") for _, name, spec, _ in Formatter().parse(template) if name is not None)
