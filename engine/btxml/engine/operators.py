"""What the operators of the script language mean for values of each type."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping
from enum import Enum
from typing import Any

from btxml.engine.errors import NodeError
from btxml.engine.literals import INT_LIMIT, number_in, shown, type_name

# Numbers this close are equal: the library compares with the precision of a float.
EPSILON = 2.0**-23
EXACT = 2**53  # whole numbers up to here are exact; beyond, a result is rounded as the library's, which is a double
TEXT_LIMIT = 10_000  # characters that a script can join

# As tuples: a union such as int | float would be made anew in every call.
_NUMBER = (int, float)
_PLAIN = (str, int, float)

Operator = Callable[[Any, Any], Any]
Comparison = Callable[[Any, Any, Mapping[str, Any]], bool]


def _arithmetic(sign: str, calculate: Operator) -> Operator:
    def operate(left: Any, right: Any) -> Any:
        if type(left) is type(right) is int or (isinstance(left, _NUMBER) and isinstance(right, _NUMBER)):
            result = calculate(left, right)
            return result if isinstance(result, float) or -EXACT <= result <= EXACT else float(result)
        if sign == "+" and isinstance(left, str) and isinstance(right, str):
            return _join(left, right)
        return operate(*_numbers(sign, left, right))

    return operate


def _divide(left: Any, right: Any) -> Any:
    if not (isinstance(left, _NUMBER) and isinstance(right, _NUMBER)):
        return _divide(*_numbers("/", left, right))
    if right == 0:
        raise NodeError(f"{left} / {right} divides by zero")
    return left / right


def _join(left: Any, right: Any) -> Any:
    if not (isinstance(left, _PLAIN) and isinstance(right, _PLAIN)):
        raise _not_taken("..", left, right)
    text = f"{_text(left)}{_text(right)}"
    if len(text) > TEXT_LIMIT:
        raise NodeError(f"a text of {len(text)} characters is too long; at most {TEXT_LIMIT}")
    return text


def _bits(sign: str, calculate: Operator) -> Operator:
    def operate(left: Any, right: Any) -> Any:
        if isinstance(left, _NUMBER) and isinstance(right, _NUMBER) and _has_bits(left) and _has_bits(right):
            return calculate(int(left), int(right))
        return operate(*_numbers(sign, left, right))

    return operate


# Arithmetic, bits and text; each raises NodeError where it does not take the values.
OPERATORS: dict[str, Operator] = {
    "+": _arithmetic("+", operator.add),
    "-": _arithmetic("-", operator.sub),
    "*": _arithmetic("*", operator.mul),
    "/": _divide,
    "..": _join,
    "|": _bits("|", operator.or_),
    "^": _bits("^", operator.xor),
    "&": _bits("&", operator.and_),
}


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
        raise NodeError(f"{shown(text)} is not a number")
    return number


def _equality(sign: str, wanted: bool) -> Comparison:
    def operate(left: Any, right: Any, enums: Mapping[str, Any]) -> bool:
        kind = type(left)
        if kind is type(right) and (kind is str or kind is int):
            return (left == right) is wanted
        if kind is not type(right):
            left, right = _alike(left, right, enums)
        if isinstance(left, _NUMBER) and isinstance(right, _NUMBER):
            return same_number(left, right) is wanted
        if isinstance(left, type(right)) or isinstance(right, type(left)):
            return bool(left == right) is wanted
        return operate(*_numbers(sign, left, right), enums)

    return operate


def _ordered(sign: str, compare: Operator) -> Comparison:
    def operate(left: Any, right: Any, enums: Mapping[str, Any]) -> bool:
        if type(left) is type(right) is int:
            return compare(left, right)  # type: ignore[no-any-return]
        if type(left) is not type(right):
            left, right = _alike(left, right, enums)
        kind = str if isinstance(left, str) else _NUMBER
        if isinstance(left, kind) and isinstance(right, kind):
            return bool(compare(left, right))
        return operate(*_numbers(sign, left, right), enums)

    return operate


# Comparisons; only numbers and texts can be ordered. Each raises NodeError where it does not take the values.
COMPARISONS: dict[str, Comparison] = {
    "==": _equality("==", True),
    "!=": _equality("!=", False),
    "<": _ordered("<", operator.lt),
    "<=": _ordered("<=", operator.le),
    ">": _ordered(">", operator.gt),
    ">=": _ordered(">=", operator.ge),
}


def _alike(left: Any, right: Any, enums: Mapping[str, Any]) -> tuple[Any, Any]:
    """Two values as a comparison takes them: a text beside a number is read as one.

    Raises:
        NodeError: the text stands for no number.
    """
    if isinstance(left, str):
        return (left, right) if isinstance(right, str) else (_like(left, right, enums), right)
    return (left, _like(right, left, enums)) if isinstance(right, str) else (left, right)


def same_number(left: int | float, right: int | float) -> bool:
    """Whether two numbers are equal to the precision of a float."""
    if left == right:
        return True
    apart = left - right
    return math.isfinite(apart) and abs(apart) <= EPSILON


def _numbers(sign: str, left: Any, right: Any) -> tuple[Any, Any]:
    """Two values with the numbers of enums in their place, as the library has them.

    Raises:
        NodeError: none of them is of such an enum, so the operator does not take them.
    """
    if not any(isinstance(operand, Enum) and isinstance(operand.value, int) for operand in (left, right)):
        raise _not_taken(sign, left, right)
    return _number(left), _number(right)


def _number(value: Any) -> Any:
    return value.value if isinstance(value, Enum) and isinstance(value.value, int) else value


def _like(text: str, other: object, enums: Mapping[str, Any]) -> Any:
    """A text as what it is compared with: a number or a member of an enum."""
    if isinstance(other, Enum):
        return enums.get(text, text)
    return number_of(text, enums) if isinstance(other, _NUMBER) else text


def unary(sign: str, value: Any) -> Any:
    """`-`, `!` and `~`.

    Raises:
        NodeError: the operator does not take this value.
    """
    value = _number(value)
    if isinstance(value, _NUMBER):
        if sign == "!":
            return not value
        if sign == "-":
            return -value
        if -INT_LIMIT <= value < INT_LIMIT:  # refuses what is not finite; a fraction is cut off, as in the library
            return ~int(value)
    raise NodeError(f"'{sign}' does not take {_described(value)}")


def truth(value: Any) -> bool:
    """Whether a value counts as true: a number other than 0, also of an enum, a text that is not empty.

    Raises:
        NodeError: the value is neither true nor false.
    """
    if value is True or value is False:
        return value
    if isinstance(value, _PLAIN):
        return bool(value)
    if isinstance(value, Enum):
        return bool(_number(value))
    raise NodeError(f"{_described(value)} is neither true nor false")


def _not_taken(sign: str, left: Any, right: Any) -> NodeError:
    return NodeError(f"'{sign}' does not take {_described(left)} and {_described(right)}")


def _text(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def _described(value: object) -> str:
    return f"the {type_name(type(value))} {shown(value)}"
