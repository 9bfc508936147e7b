"""Each row of the fault table says what a person does, in every language."""

from __future__ import annotations

import pytest

from bracket_cell.viewing.advice import ADVICE
from bracket_ground.files.words.catalogue import catalogue, languages
from bracket_ground.interfaces.faults import SIGNALS


def test_every_signal_has_advice_that_fits_into_a_line() -> None:
    assert set(ADVICE) == set(SIGNALS)
    assert all(len(words) <= 70 for words in ADVICE.values())


@pytest.mark.parametrize("language", sorted(set(languages()) - {"en"}))
def test_advice_is_there_in_every_language(language: str) -> None:
    known = catalogue(language).texts
    assert sorted(set(ADVICE.values()) - set(known)) == []
