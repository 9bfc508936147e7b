"""Words of the bench: messages that stay data, and catalogues that know them all."""

from __future__ import annotations

import pickle
from pathlib import Path

import pytest

from bracket_cell.remote.channel import ENCODER
from bracket_ground.errors import InputError
from bracket_ground.files.words import catalogue as catalogues
from bracket_ground.files.words.catalogue import Catalogue, catalogue, languages
from bracket_ground.files.words.message import Message, data_of, listed
from tests.cell.words import spoken

NEAR = Message("waiting: {reason}", reason=Message("the hand is near the way to {position}", position="p4"))


def test_a_message_is_english_text_and_data_that_another_language_fills_in() -> None:
    assert NEAR == "waiting: the hand is near the way to p4"
    assert catalogue("de")(NEAR) == "wartet: die Hand ist nah am Weg zu p4"
    assert catalogue("en")(NEAR) == NEAR
    assert data_of(NEAR) == [
        "waiting: {reason}",
        {"reason": ["the hand is near the way to {position}", {"position": "p4"}]},
    ]
    assert catalogue("de")("what nobody translated") == "what nobody translated"


def test_a_number_is_written_at_once_so_that_ids_are_without_formats() -> None:
    sure = Message("{part} has probability {share:.2f}", part="o1", share=0.912)
    assert sure == "o1 has probability 0.91"
    assert data_of(sure) == ["{part} has probability {share}", {"part": "o1", "share": "0.91"}]


def test_a_message_stays_one_in_another_process_and_a_text_on_the_wire() -> None:
    again = pickle.loads(pickle.dumps(NEAR))
    assert catalogue("de")(again) == catalogue("de")(NEAR)
    assert ENCODER.encode(NEAR) == ENCODER.encode(str(NEAR))


def test_several_messages_are_one_that_is_translated_in_parts() -> None:
    both = listed([NEAR, "paused"])
    assert both == f"{NEAR}; paused"
    assert catalogue("de")(both) == "wartet: die Hand ist nah am Weg zu p4; angehalten"


@pytest.mark.parametrize("language", [name for name in languages() if name != "en"])
def test_every_text_that_people_read_at_the_bench_is_translated(language: str) -> None:
    known = catalogue(language).texts
    assert {text: place for text, place in spoken().items() if text not in known} == {}


def test_a_third_language_is_one_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "nl.po").write_text('msgid "waiting: {reason}"\nmsgstr "wacht: {reason}"\n', encoding="utf-8")
    (tmp_path / "xx.po").write_text(
        'msgid ""\nmsgstr ""\n\nmsgid "waiting: {reason}"\nmsgstr "wait {raeson}"\n', encoding="utf-8"
    )
    monkeypatch.setattr(catalogues, "FOLDER", tmp_path)
    made: Catalogue = catalogue.__wrapped__("nl")
    assert languages() == ["en", "nl", "xx"]
    assert made(NEAR) == "wacht: the hand is near the way to p4"
    with pytest.raises(InputError, match=r"xx\.po:4: .*raeson.*'reason'"):
        catalogue.__wrapped__("xx")
    with pytest.raises(InputError, match="no language 'fr'; there are: en, nl, xx"):
        catalogue.__wrapped__("fr")
