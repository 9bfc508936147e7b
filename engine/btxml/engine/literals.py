"""Conversion of strings from XML, and of blackboard values, to the types of ports."""

from __future__ import annotations

import json
import math
import re
import types
import typing
from enum import Enum
from functools import lru_cache
from typing import Any

from btxml.engine.status import FAILURE, RUNNING, SKIPPED, SUCCESS, Status
from btxml.engine.vocabulary import Word, is_word

STATUS_WORDS = {status.name: status for status in (SUCCESS, FAILURE, RUNNING, SKIPPED)}
TRUE_WORDS = ("true", "True", "TRUE", "1")
FALSE_WORDS = ("false", "False", "FALSE", "0")
JSON = "json:"  # begins a value of a port that is written as JSON, as in the library
INT_LIMIT = 2**63  # whole numbers have 64 bits, as in the library

# What a number may look like: Python's own grammar would also take "1_0", "inf" and digits of other alphabets.
_WHOLE = re.compile(r"-?[0-9]+\Z")
_REAL = re.compile(r"-?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?\Z")


class LiteralError(ValueError):
    """A value does not fit a type; `legal` says what does."""

    def __init__(self, what: str, legal: str) -> None:
        super().__init__(what)
        self.legal = legal


def type_name(kind: Any) -> str:
    """A type as people write it: `int`, `list[str]`, `AssemblyState`."""
    if kind is Any or kind is ...:
        return "any" if kind is Any else "..."
    if isinstance(kind, types.GenericAlias):
        return f"{kind.__origin__.__name__}[{', '.join(map(type_name, kind.__args__))}]"
    return str(getattr(kind, "__name__", kind))


def has_literals(kind: Any) -> bool:
    """Whether a value of this type can be written in a tree file."""
    if kind in (int, float, bool, str, Any) or is_word(kind) or hasattr(kind, "from_text"):
        return True
    if typing.get_origin(kind) in (list, tuple):
        return has_literals(_item(kind))
    return isinstance(kind, type) and issubclass(kind, Enum)


def from_text(text: str, kind: Any) -> Any:
    """The value that a string in a tree file means for a port of type `kind`.

    Raises:
        LiteralError: it means none.
    """
    if kind is str or kind is Any or is_word(kind):
        return text
    if kind is bool:
        return _boolean(text)
    if kind is int or kind is float:
        return _number(text, kind)
    if typing.get_origin(kind) in (list, tuple) and text.startswith(JSON):
        return _json_list(text, kind)
    if typing.get_origin(kind) in (list, tuple):
        items = [from_text(item, _item(kind)) for item in text.split(";")] if text else []
        return typing.get_origin(kind)(items)
    if hasattr(kind, "from_text"):
        return _own(text, kind)
    if isinstance(kind, type) and issubclass(kind, Enum):
        return _member(text, kind)
    raise LiteralError(
        f"'{text}' cannot become a {type_name(kind)}", "connect this port to a blackboard entry: {entry}"
    )


def to_text(value: Any) -> str:
    """How a tree file writes a value: what `from_text` reads as the same one."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, list | tuple):
        return ";".join(map(to_text, value))
    return str(value)


def constant(text: str) -> int | float | str:
    """What an attribute of a SubTree passes in: an int, else a float, else the string itself."""
    number = number_in(text)
    return text if number is None else number


@lru_cache(256)  # a tree compares the same few texts over and over
def number_in(text: str) -> int | float | None:
    """The number that a text spells out, None where it spells none; beyond 64 bits it is a float, and always finite."""
    if _WHOLE.match(text) and len(text) <= 20 and -INT_LIMIT <= int(text) < INT_LIMIT:
        return int(text)
    if _REAL.match(text) and math.isfinite(float(text)):
        return float(text)
    return None


def converted(value: Any, kind: Any) -> Any:
    """A blackboard value as a port of type `kind` reads it: strings are parsed, numbers change without loss.

    Raises:
        LiteralError: the value does not fit.
    """
    if is_word(kind):
        kind = str
    if isinstance(value, Word):
        value = str(value)
    if fits(value, kind):
        return value
    if isinstance(value, str):
        return from_text(value, kind)
    if kind is str and isinstance(value, int | float | Enum):
        return to_text(value)
    if isinstance(value, int | float) and kind in (int, float, bool) and _without_loss(value, kind):
        return kind(value)
    if isinstance(kind, type) and issubclass(kind, Enum) and isinstance(value, int | float):
        return _member(str(value), kind)
    raise LiteralError(f"{shown(value)} is {a_type(type(value))}", f"the port takes {a_type(kind)}")


def fits(value: Any, kind: Any) -> bool:
    """Whether a value is of a port's type as it stands."""
    if kind is Any:
        return True
    if kind in (int, float) and isinstance(value, bool):
        return False
    return isinstance(value, typing.get_origin(kind) or kind)


def shown(value: object) -> str:
    """A value in a message: short, whatever it is."""
    try:
        text = repr(value)
    except Exception:  # a class of the user's own may raise anything, and a number of thousands of digits does
        text = f"a {type(value).__name__}"
    return text if len(text) <= 60 else text[:57] + "..."


def a_type(kind: Any) -> str:
    """A type with its article: `an int`, `a float`."""
    name = type_name(kind)
    return f"{'an' if name[0] in 'aeiouAEIOU' else 'a'} {name}"


def _without_loss(value: int | float, kind: type[int] | type[float] | type[bool]) -> bool:
    if kind is float and isinstance(value, float):
        return True
    return abs(value) < INT_LIMIT and kind(value) == value  # what is not finite ends at the first part


def _item(kind: Any) -> Any:
    return (typing.get_args(kind) or (str,))[0]


def _json_list(text: str, kind: Any) -> Any:
    try:
        items = json.loads(text.removeprefix(JSON))
    except ValueError:
        raise LiteralError(f"'{text}' is not JSON", "like json:[1, 2]") from None
    if not isinstance(items, list):
        raise LiteralError(f"'{text}' is {a_type(type(items))}, not a list", "like json:[1, 2]")
    return typing.get_origin(kind)([converted(item, _item(kind)) for item in items])


def _own(text: str, kind: Any) -> Any:
    """A value of a class that reads its own texts: `from_text` makes it, `like` says how they look."""
    try:
        return kind.from_text(text)
    except Exception as error:  # a class of the user's own may raise anything; to the file it is a bad text
        what = f"'{text}' is not a valid {type_name(kind)}: {error}"
        raise LiteralError(what, getattr(kind, "like", "see the class's documentation")) from None


def _boolean(text: str) -> bool:
    if text in TRUE_WORDS:
        return True
    if text in FALSE_WORDS:
        return False
    raise LiteralError(f"'{text}' is not a bool", "true or false")


def _number(text: str, kind: type[int] | type[float]) -> int | float:
    number = number_in(text)
    if number is None or (kind is int and isinstance(number, float)):
        raise LiteralError(f"'{text}' is not {a_type(kind)}", f"like {'42' if kind is int else '0.5'}")
    return kind(number)


def _member(text: str, kind: type[Enum]) -> Enum:
    if kind is Status:
        members: dict[str, Any] = dict(STATUS_WORDS)
    else:
        members = {member.name: member for member in kind}
        members |= {str(member.value): member for member in kind if isinstance(member.value, int)}
    if text in members:
        member: Enum = members[text]
        return member
    names = STATUS_WORDS if kind is Status else kind.__members__
    raise LiteralError(f"'{text}' is not a valid {kind.__name__}", "one of " + ", ".join(names))
