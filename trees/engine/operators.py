"""What the operators of the script language mean for values of each type."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from enum import Enum
from typing import Any

from trees.engine.errors import NodeError
from trees.engine.literals import type_name

# Numbers this close are equal: the library compares with the precision of a float.
EPSILON = 2.0**-23

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
            return f"{_shown(left)}{_shown(right)}"
    elif isinstance(left, int | float) and isinstance(right, int | float):
        if sign in _ARITHMETIC:
            return _ARITHMETIC[sign](left, right)
        if sign == "/":
            return _divide(left, right)
        if float(left).is_integer() and float(right).is_integer():
            return _BITS[sign](int(left), int(right))
    raise NodeError(f"'{sign}' does not take {_described(left)} and {_described(right)}")


def _divide(left: float, right: float) -> float:
    if right == 0:
        raise NodeError(f"{left} / {right} divides by zero")
    return left / right


def compares(sign: str, left: Any, right: Any) -> bool:
    """Whether a comparison holds; only values of one kind can be compared, and only numbers and texts ordered.

    Raises:
        NodeError: the values cannot be compared.
    """
    numbers = isinstance(left, int | float) and isinstance(right, int | float)
    if sign in ("==", "!="):
        if not (numbers or isinstance(left, type(right)) or isinstance(right, type(left))):
            raise NodeError(f"'{sign}' does not take {_described(left)} and {_described(right)}")
        same = abs(left - right) <= EPSILON if numbers and math.isfinite(left - right) else bool(left == right)
        return same is (sign == "==")
    if numbers or (isinstance(left, str) and isinstance(right, str)):
        return _ORDER[sign](left, right)
    raise NodeError(f"'{sign}' does not take {_described(left)} and {_described(right)}")


def unary(sign: str, value: Any) -> Any:
    """`-`, `!` and `~`.

    Raises:
        NodeError: the operator does not take this value.
    """
    if sign == "!" and isinstance(value, int | float):
        return not value
    if sign == "-" and isinstance(value, int | float):
        return -value
    if sign == "~" and isinstance(value, int | float) and float(value).is_integer():
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


def _shown(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def _described(value: object) -> str:
    return f"the {type_name(type(value))} {value!r}"
