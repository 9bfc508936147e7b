"""README is short, begins with the film, and shows what `make run` prints; figures may differ between processors."""

from __future__ import annotations

import cv2
import pytest

from tests import ROOT
from tests.docs.first_run import SAMPLE, first_run, printed, sample
from tests.docs.pictures import FILM

README = ROOT / "README.md"


def test_readme_is_short_and_begins_with_the_film() -> None:
    text = README.read_text()
    assert len(text.split()) <= 450
    assert f"]({FILM})" in text[:200]


def test_the_film_is_small_and_moves() -> None:
    assert (ROOT / FILM).stat().st_size < 2_000_000
    read, film = cv2.imreadanimation(str(ROOT / FILM))
    assert read
    assert len(film.frames) > 100


@pytest.mark.slow
def test_the_sample_is_what_the_cell_prints() -> None:
    shown = SAMPLE.search(README.read_text())
    assert shown is not None
    made = sample(first_run().lines)
    assert [line.words for line in printed(shown[0])] == [line.words for line in printed(made)], "make pictures"
