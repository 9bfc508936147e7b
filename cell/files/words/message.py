"""Messages as data: an id, which is the English text with names in braces, and the values of these names."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


class Message(str):
    """Words for people, as data: where a text is expected it is the English one, a catalogue knows others.

    Attributes:
        id: the English text with {names}; the key of every catalogue.
        values: what stands for the names; messages among them are translated, too.

    Example:
        Message("bringing {part} to {position}", part="o1", position="p3")
    """

    id: str
    values: Mapping[str, Any]

    def __new__(cls, id: str, /, **values: Any) -> Message:
        made = super().__new__(cls, id.format(**values) if values else id)
        made.id, made.values = id, values
        return made

    def __reduce__(self) -> tuple[Any, ...]:
        return _made, (self.id, dict(self.values))


def listed(messages: list[str], mark: str = "; ") -> str:
    """Several messages as one, joined by a mark."""
    joined, *rest = messages or [""]
    for one in rest:
        joined = Message(f"{{first}}{mark}{{second}}", first=joined, second=one)
    return joined


def data_of(text: str | None) -> Any:
    """A message as plain data, [id, values], for another program that has a catalogue; other texts as they are."""
    if not isinstance(text, Message) or not text.values:
        return text
    return [text.id, {name: data_of(one) if isinstance(one, str) else one for name, one in text.values.items()}]


def _made(id: str, values: Mapping[str, Any]) -> Message:
    return Message(id, **values)
