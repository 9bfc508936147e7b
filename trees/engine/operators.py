"""What the operators of the script language mean for values of each type."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping
from enum import Enum
from typing import Any

from trees.engine.errors import NodeError
from trees.engine.literals import INT_LIMIT, number_in, shown, type_name

# Numbers this close are equal: the library compares with the precision of a float.
EPSILON = 2.0**-23
EXACT = 2**53  # whole numbers up to here are exact; beyond, a result is rounded as the library's, which is a double
TEXT_LIMIT = 10_000  # characters that a script can join

_ARITHMETIC: dict[str, Callable[[Any, Any], Any]] = {"+": operator.add, "-": operator.sub, "*": operator.mul}
_BITS: dict[str, Callable[[int, int], int]] = {"|": operator.or_, "^": operator.xor, "&": operator.and_}
_ORDER: dict[str, Callable[[Any, Any], bool]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}


def combine(sign: str, left: Any, right: Any) -> Any:
    """Arithmetic, bits and text.

    Raises:
        NodeError: the operator does not take these values.
    """
    if sign == ".." or (sign == "+" and isinstance(left, str) and isinstance(right, str)):
        if isinstance(left, str | int | float) and isinstance(right, str | int | float):
            return _joined(f"{_text(left)}{_text(right)}")
    elif isinstance(left, int | float) and isinstance(right, int | float):
        if sign in _ARITHMETIC:
            result = _ARITHMETIC[sign](left, right)
            return result if isinstance(result, float) or -EXACT <= result <= EXACT else float(result)
        if sign == "/":
            return _divide(left, right)
        if _has_bits(left) and _has_bits(right):
            return _BITS[sign](int(left), int(right))
    raise NodeError(f"'{sign}' does not take {_described(left)} and {_described(right)}")


def _divide(left: float, right: float) -> float:
    if right == 0:
        raise NodeError(f"{left} / {right} divides by zero")
    return left / right


def _joined(text: str) -> str:
    if len(text) > TEXT_LIMIT:
        raise NodeError(f"a text of {len(text)} characters is too long; at most {TEXT_LIMIT}")
    return text


def _has_bits(value: int | float) -> bool:
    return -INT_LIMIT <= value < INT_LIMIT and value == int(value)  # the first part refuses what is not finite


def number_of(text: str, enums: Mapping[str, Any]) -> int | float:
    """The number that a text stands for where a number is wanted: `true`, `false`, the name of an enum, or digits.

    Raises:
        NodeError: it stands for none.
    """
    if text in ("true", "false"):
        return int(text == "true")
    member = enums.get(text)
    number = member if isinstance(member, int | float) else number_in(text)
    if number is None:
        raise NodeError(f"{shown(text)} is no number")
    return number


def compares(sign: str, left: Any, right: Any, enums: Mapping[str, Any]) -> bool:
    """Whether a comparison holds; only numbers and texts can be ordered, and a text beside a number is read as one.

    Raises:
        NodeError: the values cannot be compared.
    """
    if isinstance(left, str) and not isinstance(right, str):
        left = _like(left, right, enums)
    elif isinstance(right, str) and not isinstance(left, str):
        right = _like(right, left, enums)
    numbers = isinstance(left, int | float) and isinstance(right, int | float)
    if sign in ("==", "!="):
        if not (numbers or isinstance(left, type(right)) or isinstance(right, type(left))):
            raise NodeError(f"'{sign}' does not take {_described(left)} and {_described(right)}")
        return (same_number(left, right) if numbers else bool(left == right)) is (sign == "==")
    if numbers or (isinstance(left, str) and isinstance(right, str)):
        return _ORDER[sign](left, right)
    raise NodeError(f"'{sign}' does not take {_described(left)} and {_described(right)}")


def same_number(left: int | float, right: int | float) -> bool:
    """Whether two numbers are equal to the precision of a float."""
    apart = left - right
    return abs(apart) <= EPSILON if math.isfinite(apart) else left == right


def _like(text: str, other: object, enums: Mapping[str, Any]) -> Any:
    """A text as what it is compared with: a number or a member of an enum."""
    if isinstance(other, Enum):
        return enums.get(text, text)
    return number_of(text, enums) if isinstance(other, int | float) else text


def unary(sign: str, value: Any) -> Any:
    """`-`, `!` and `~`.

    Raises:
        NodeError: the operator does not take this value.
    """
    if sign == "!" and isinstance(value, int | float):
        return not value
    if sign == "-" and isinstance(value, int | float):
        return -value
    if sign == "~" and isinstance(value, int | float) and _has_bits(value):
        return ~int(value)
    raise NodeError(f"'{sign}' does not take {_described(value)}")


def truth(value: Any) -> bool:
    """Whether a value counts as true: a number other than 0, a text that is not empty, any enum member.

    Raises:
        NodeError: the value is neither true nor false.
    """
    if isinstance(value, int | float | str):
        return bool(value)
    if isinstance(value, Enum):
        return True
    raise NodeError(f"{_described(value)} is neither true nor false")


def _text(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def _described(value: object) -> str:
    return f"the {type_name(type(value))} {shown(value)}"
