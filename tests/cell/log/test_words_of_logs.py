"""What is wrong in a log is said in words, by the log's name: none of a library, of Python, or of a folder in /tmp."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import orjson
import pytest
from mcap.writer import Writer

from bracket_cell.commands.main import main
from bracket_cell.log.read.reader import read_log
from bracket_cell.log.read.ticks import TickBuilder
from bracket_cell.log.report.text import note_text
from bracket_ground.errors import LogError, mistakes
from tests.cell.log.test_hostile_log import CASE

case = cache(partial(read_log, CASE))
OF_A_LIBRARY = re.compile(r"\b\w*Error\b|pydantic|input_value|/tmp/cell-|\n")


def without_tick(data: bytes) -> bytes:
    fields = orjson.loads(data)
    fields.pop("tick", None)
    return orjson.dumps(fields)


def rewritten(path: Path, topic: str, fields: dict[str, Any]) -> Path:
    """The beginning of a log, whose first message of a topic has other fields."""
    log, channels, counts, todo = case(), dict[str, int](), Counter[str](), True
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("cell")
        for message in log.messages[:300]:
            data = message.data
            if todo and message.topic == topic:
                data, todo = orjson.dumps(orjson.loads(data) | fields), False
            if message.topic not in channels:
                channels[message.topic] = writer.register_channel(message.topic, message.encoding, 0)
            counts[message.topic] += 1
            number = counts[message.topic]
            writer.add_message(channels[message.topic], message.time_ns, data, message.time_ns, number)
        writer.add_metadata("run", dict(log.metadata))
        for name, data in log.attachments.items():
            writer.add_attachment(0, 0, name, "", data)
        writer.finish()  # type: ignore[no-untyped-call]
    return path


@pytest.mark.parametrize("topic", ["/observation", "/tick", "/timing", "/judgement", "/command"])
@pytest.mark.parametrize(
    "spoil", [lambda _: b"{", lambda _: b"[]", lambda _: b'"text"', lambda _: b"\xff", lambda _: b"{}", without_tick]
)
def test_a_message_that_is_wrong_is_told_in_words(topic: str, spoil: Callable[[bytes], bytes]) -> None:
    messages = case().messages
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


@pytest.mark.parametrize(
    ("topic", "fields", "words"),
    [
        ("/timing", {"wall_s": "x"}, "wall_s: input should be a number"),
        ("/tick", {"changes": [{"path": 3}]}, "changes.0.path: input should be text"),
        ("/judgement", {"reasons": [["arm_lost", 1]]}, "reasons.0.words: input should be text"),
        ("/observation", {"time_s": {}}, "time_s: input should be a number"),
        ("/command", {"follow": []}, "follow: input should be keys with values"),
    ],
)
def test_a_message_of_other_types_is_refused_by_what_is_wrong(topic: str, fields: dict[str, Any], words: str) -> None:
    messages = case().messages
    place = next(place for place, message in enumerate(messages) if message.topic == topic)
    builder = TickBuilder(CASE)
    for message in messages[:place]:
        builder.take(message)
    with pytest.raises(LogError, match=rf"message of {topic} at .* does not hold what it should: {words}"):
        builder.take(replace(messages[place], data=orjson.dumps(orjson.loads(messages[place].data) | fields)))


@pytest.mark.parametrize(
    ("topic", "fields"),
    [
        ("plan", {"guidance": {"o1": [None]}}),
        ("plan", {"required": 1, "solution": [], "graspable": "much"}),
        ("belief", {"goals": {"g0": "likely"}}),
        ("cause", {"relation": "beside"}),
        ("help", {"costs": []}),
    ],
)
def test_a_note_that_no_sentence_fits_is_shown_as_it_is(topic: str, fields: dict[str, Any]) -> None:
    assert note_text(topic, fields).startswith(topic)


def test_what_a_log_says_moves_no_cursor(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Neither as an answer nor within a refusal; and what another program wrote is no log."""
    spoilt = {"/note/skill": {"reason": "\x1b[2Jgone"}, "/tick": {"tick": "\x1b[2J"}}
    for topic, fields in spoilt.items():
        log = rewritten(tmp_path / "log.mcap", topic, fields)
        assert main(["log", "ticks", str(log)]) == (2 if topic == "/tick" else 0)
        told = "".join(capsys.readouterr())
        assert "\x1b" not in told
        assert "x1b[2J" in told or topic == "/tick"


def test_a_tree_of_a_log_moves_no_cursor(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tick = next(message for message in case().messages if message.topic == "/tick")
    changes = [{**row, "feedback": "\x1b[2Jgone"} for row in orjson.loads(tick.data)["changes"]]
    assert main(["show", str(rewritten(tmp_path / "log.mcap", "/tick", {"changes": changes})), "--at", "0"]) == 0
    told = capsys.readouterr().out
    assert "\\x1b[2Jgone" in told
    assert "\x1b" not in told


def test_why_is_asked_of_logs_of_this_program_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    foreign, wrong = tmp_path / "ros.mcap", tmp_path / "wrong.mcap"
    for path, profile, data in ((foreign, "ros2", b"{}"), (wrong, "cell", b"[]")):
        with path.open("wb") as file:
            writer = Writer(file)
            writer.start(profile)
            writer.add_message(writer.register_channel("/tick", "json", 0), 0, data, 0, 1)
            writer.finish()  # type: ignore[no-untyped-call]
    assert main(["log", "why", str(foreign)]) == 2
    assert "is not a log of this program: an MCAP file with profile 'ros2'" in capsys.readouterr().err
    assert main(["log", "why", str(wrong)]) == 2
    assert not OF_A_LIBRARY.search(capsys.readouterr().err.rstrip("\n"))
