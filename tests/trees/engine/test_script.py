"""The script language: values, operators, binding strength and errors."""

from __future__ import annotations

from enum import Enum
from typing import Any

import pytest

from btxml.engine.blackboard import Scope
from btxml.engine.errors import NodeError
from btxml.engine.script import ScriptError, parse_script

ENUMS = {"RED": 1, "BLUE": 2}


class Kind(Enum):
    """An enum without numbers."""

    SCREW = "screw"
    IDLE = "idle"


class Odd:
    """A value whose comparison raises."""

    def __eq__(self, other: object) -> bool:
        raise ValueError("it cannot be compared")

    def __hash__(self) -> int:
        return 0


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
        ("'a' < 1", "'a' is not a number"),
        ("'a' == 1", "'a' is not a number"),
        ("' 5 ' == 5", "' 5 ' is not a number"),
        ("'1_0' == 10", "'1_0' is not a number"),
        ("x = 'nan'", "{x} holds 5 and cannot be assigned"),
        ("big = 1e300 * 1e300", "{big} holds 4 and cannot be assigned"),
        ("~1e300", "'~' does not take the float 1e+300"),
        ("1e300 | 1", "'|' does not take the float 1e+300"),
        ("odd == odd", "the script failed: ValueError: 'it cannot be compared'"),
        ("-'a'", "'-' does not take the str 'a'"),
        ("1.5 & 1", "'&' does not take the float 1.5 and the int 1"),
        ("x = 'a'", "{x} holds 5 and cannot be assigned"),
        ("x = 1.5", "{x} holds 5 and cannot be assigned"),
        ("thing && true", "is neither true nor false"),
    ],
)
def test_errors_while_running_are_node_errors(source: str, reason: str) -> None:
    with pytest.raises(NodeError) as raised:
        run(source, x=5, thing=object(), big=4, odd=Odd())
    assert reason in str(raised.value)


def test_logic_stops_as_soon_as_it_can() -> None:
    assert run("false && y") is False
    assert run("true || y") is True


def test_entries_are_noted_with_their_places() -> None:
    script = parse_script("a := b; c += 1", Scope(), {})
    assert [(use.entry.name, use.offset, use.sign) for use in script.uses] == [
        ("b", 5, ""),
        ("a", 0, ":="),
        ("c", 8, "+="),
    ]


@pytest.mark.parametrize(
    ("source", "value"),
    [
        ("n == 5", True),
        ("5 == '5'", True),
        ("n < 7", True),
        ("s == RED", True),
        ("s != BLUE", True),
        ("t == true", True),
        ("kind == 'SCREW'", True),
        ("x = '7.5'; x", 7.5),
        ("x = 'RED'; x", 1),
        ("on += 1; on", 2),
        ("on = 5; on", 5),
        ("9007199254740992 + 1", 2.0**53),
        ("0xFFFFFFFFFFFFFFFF", 2.0**64),
    ],
)
def test_text_is_read_as_a_number_where_a_number_is_wanted(source: str, value: object) -> None:
    assert run(source, n="5", s="RED", t="true", kind=Kind.SCREW, x=1, on=True) == value


def test_numbers_stay_small_however_often_they_are_multiplied() -> None:
    scope = Scope()
    scope.entry("n").value = 3
    script = parse_script("n *= n", scope, {})
    for _ in range(5):
        script.run()
    with pytest.raises(NodeError, match="cannot be assigned"):
        script.run()
    assert scope.entry("n").value == 3**32


def test_text_does_not_grow_without_end() -> None:
    scope = Scope()
    scope.entry("s").value = "ab"
    script = parse_script("s = s .. s", scope, {})
    for _ in range(12):
        script.run()
    with pytest.raises(NodeError, match="is too long; at most 10000"):
        script.run()
    assert len(scope.entry("s").value) == 2**13


@pytest.mark.parametrize(
    ("source", "offset", "what", "legal"),
    [
        ("n := " + "9" * 5000, 5, "'999999999999' is too large a number", "at most 1.7e308"),
        ("n := 0x" + "F" * 9000, 5, "is too large", "at most 64 bits"),
        ("a > 1 and b", 6, "'and' stands where an operator or ';' is expected", "did you mean '&&'?"),
        ("not a", 4, "'a' stands where an operator", "did you mean '!'?"),
        ("a := 'open; b := 1", 5, "the text 'open has no end", "close it with '"),
        ('a := "open; b := 1', 5, 'the text "open has no end', 'close it with "'),
        ("a := $price", 5, "'$price' has no meaning here", ""),
    ],
)
def test_what_cannot_be_compiled_names_the_word(source: str, offset: int, what: str, legal: str) -> None:
    with pytest.raises(ScriptError) as raised:
        parse_script(source, Scope(), {})
    assert (raised.value.offset, what in str(raised.value), legal in raised.value.legal) == (offset, True, True)
