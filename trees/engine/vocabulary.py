"""Texts that name a thing of the loaded configuration: types of ports that know which names there are."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar


class Word(str):
    """A name from the configuration; in ticks a plain text.

    Attributes:
        thing: what it names, for messages.
    """

    __slots__ = ()
    thing: ClassVar[str] = "name"


class Part(Word):
    """A part type of the product."""

    __slots__ = ()
    thing: ClassVar[str] = "part type"


class Hole(Word):
    """A position of the product, where a part belongs."""

    __slots__ = ()
    thing: ClassVar[str] = "position"


Words = Mapping[type[Word], tuple[str, ...]]


def is_word(kind: Any) -> bool:
    """Whether a port of this type takes only names of the configuration."""
    return isinstance(kind, type) and issubclass(kind, Word)


def misnomer(value: object, kind: Any, words: Words) -> tuple[str, str] | None:
    """What is wrong with a name, and which there are; None where it is legal, or nothing is loaded to tell."""
    known = words.get(kind) if is_word(kind) else None
    if known is None or value in known:
        return None
    return f"the product has no {kind.thing} '{value}'", "one of " + ", ".join(known)
