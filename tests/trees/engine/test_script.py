"""The script language: values, operators, binding strength and errors."""

from __future__ import annotations

from enum import Enum
from typing import Any

import pytest

from trees.engine.blackboard import Scope
from trees.engine.errors import NodeError
from trees.engine.script import parse_script

ENUMS = {"RED": 1, "BLUE": 2}


class Kind(Enum):
    """An enum without numbers."""

    SCREW = "screw"
    IDLE = "idle"


def run(source: str, **entries: Any) -> Any:
    scope = Scope()
    for key, value in entries.items():
        scope.entry(key).value = value
    return parse_script(source, scope, {**ENUMS, **Kind.__members__}).run()


@pytest.mark.parametrize(
    ("source", "value"),
    [
        ("1 + 2 * 3", 7),
        ("(1 + 2) * 3", 9),
        ("10 - 4 - 3", 3),
        ("7 / 2", 3.5),
        ("8 / 2", 4),
        ("-2 * -3", 6),
        ("!0", True),
        ("!true || true", True),
        ("~5", -6),
        ("0x1F", 31),
        (".5 + 1e-1", 0.6),
        ("6 & 3", 2),
        ("6 | 3", 7),
        ("6 ^ 3", 5),
        ("1 | 2 & 3", 3),
        ("1 + 1 == 2", True),
        ("1 < 2 < 3", True),
        ("1 < 3 < 2", False),
        ("3 > 2 >= 2 != 1", True),
        ("1 == 1 && 2 == 3 || true", True),
        ("'a' == 'a'", True),
        ("'a' < 'b'", True),
        ("'a' + 'b'", "ab"),
        ("'n' .. 5 .. true", "n5true"),
        ("true ? 1 : 2", 1),
        ("false ? 1 : true ? 2 : 3", 2),
        ("'' ? 1 : 2", 2),
        ("RED + BLUE", 3),
        ("0.1 + 0.2 == 0.3", True),
        ("x + 1", 6),
        ("x = 7; x * 2", 14),
        ("n := x += 2; n + x", 14),
        ("x -= 1; x *= 3; x /= 2", 6),
        ("kind == SCREW", True),
        ("kind != IDLE", True),
        ("@top := 4; @top", 4),
        (" \n x \n ; ", 5),
    ],
)
def test_values(source: str, value: Any) -> None:
    assert run(source, x=5, kind=Kind.SCREW) == pytest.approx(value)


@pytest.mark.parametrize(
    ("source", "reason"),
    [
        ("y + 1", "nothing has been written to {y} yet"),
        ("y = 1", "{y} does not exist yet; := creates it"),
        ("y += 1", "{y} does not exist yet"),
        ("1 / 0", "1 / 0 divides by zero"),
        ("'a' - 1", "'-' does not take the str 'a' and the int 1"),
        ("'a' < 1", "'<' does not take the str 'a' and the int 1"),
        ("'a' == 1", "'==' does not take the str 'a' and the int 1"),
        ("-'a'", "'-' does not take the str 'a'"),
        ("1.5 & 1", "'&' does not take the float 1.5 and the int 1"),
        ("x = 'a'", "{x} holds 5 and cannot be assigned"),
        ("x = 1.5", "{x} holds 5 and cannot be assigned"),
        ("thing && true", "is neither true nor false"),
    ],
)
def test_errors_while_running_are_node_errors(source: str, reason: str) -> None:
    with pytest.raises(NodeError) as raised:
        run(source, x=5, thing=object())
    assert reason in str(raised.value)


def test_logic_stops_as_soon_as_it_can() -> None:
    assert run("false && y") is False
    assert run("true || y") is True


def test_entries_are_noted_with_their_places() -> None:
    script = parse_script("a := b; c += 1", Scope(), {})
    assert [(entry.name, offset, read, written) for entry, offset, read, written in script.uses] == [
        ("b", 5, True, False),
        ("a", 0, False, True),
        ("c", 8, True, True),
    ]
