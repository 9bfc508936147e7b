"""What is wrong in a log is said in words, by the log's name: none of a library, of Python, or of a folder in /tmp."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

import orjson
import pytest

from bracket_cell.log.read.reader import read_log
from bracket_cell.log.read.ticks import TickBuilder
from bracket_ground.errors import LogError, mistakes
from tests.cell.log.test_hostile_log import CASE

OF_A_LIBRARY = re.compile(r"\b\w*Error\b|pydantic|input_value|/tmp/cell-|\n")


def without_tick(data: bytes) -> bytes:
    fields = orjson.loads(data)
    fields.pop("tick", None)
    return orjson.dumps(fields)


@pytest.mark.parametrize("topic", ["/observation", "/tick", "/timing", "/judgement", "/command"])
@pytest.mark.parametrize(
    "spoil", [lambda _: b"{", lambda _: b"[]", lambda _: b'"text"', lambda _: b"\xff", lambda _: b"{}", without_tick]
)
def test_a_message_that_is_wrong_is_told_in_words(topic: str, spoil: Callable[[bytes], bytes]) -> None:
    messages = read_log(CASE).messages
    first = next(place for place, message in enumerate(messages) if message.topic == topic)
    builder = TickBuilder(CASE)
    builder.begin(0)
    for message in messages[:first]:
        builder.take(message)
    with pytest.raises(LogError) as refused:
        builder.take(replace(messages[first], data=spoil(messages[first].data)))
    assert not OF_A_LIBRARY.search(str(refused.value)), refused.value


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (KeyError("tick"), "has no tick"),
        (KeyError(10**3000), "has no "),
        (IndexError("list index out of range"), "has too few values"),
        (TypeError("'int' object is not a mapping"), "has a value of another kind than it should"),
        (ValueError("speed must be above 0"), "speed must be above 0"),
    ],
)
def test_what_data_that_do_not_fit_raise_is_told_in_words(error: Exception, words: str) -> None:
    assert mistakes(error)[0].startswith(words)
    assert len(mistakes(error)[0]) < 200
