"""Texts that name a thing of the loaded configuration: types of ports that know which names there are."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

Words = Mapping[type[Any], tuple[str, ...]]  # by kind of port; each has `missing` and `name_in`, as Word


class Word(str):
    """A name from the configuration; in ticks a plain text.

    Attributes:
        missing: how a message begins that there is none of this name.
    """

    __slots__ = ()
    missing: ClassVar[str] = "there is no name"

    @staticmethod
    def name_in(value: object) -> object:
        """The name that a value holds: the value itself."""
        return value


def is_word(kind: Any) -> bool:
    """Whether a port of this type takes only names of the configuration."""
    return isinstance(kind, type) and issubclass(kind, Word)


def misnomer(value: object, kind: Any, words: Words) -> tuple[str, str] | None:
    """What is wrong with a name, and which there are; None where it is legal, or nothing is loaded to tell."""
    known = words.get(kind) if isinstance(kind, type) else None
    if known is None or (name := kind.name_in(value)) in known:
        return None
    return f"{kind.missing} '{name}'", "one of " + ", ".join(known) if known else "the configuration names none"
