"""Pictures and pages that programs make are up to date, and every picture is shown and made by something."""

from __future__ import annotations

import numpy as np
import pytest

from tests import ROOT
from tests.docs.pictures import FILM, MADE, PAGE, PARTS, PHOTOGRAPH, STANCES

DOCS = ROOT / "docs"
MEASURED = {"imitating.svg", "learning.svg", "many_runs.svg"}  # drawn by the commands that measure, as their page says


@pytest.mark.parametrize("name", MADE)
def test_what_is_made_is_up_to_date(name: str) -> None:
    assert (ROOT / name).read_text() == MADE[name](), "make pictures"


@pytest.mark.slow
def test_the_photograph_shows_the_cell_of_today() -> None:
    import cv2

    from tests.docs.photograph import photograph

    stored = cv2.imread(str(ROOT / PHOTOGRAPH))
    assert stored is not None
    shown = cv2.cvtColor(stored, cv2.COLOR_BGR2RGB).astype(float)
    assert np.abs(shown - photograph()).mean() < 2, "make pictures"


@pytest.mark.slow
def test_the_sheet_shows_the_parts_of_today() -> None:
    import cv2

    from tests.docs.parts_sheet import sheet

    stored = cv2.imread(str(ROOT / PARTS))
    assert stored is not None
    assert np.abs(cv2.cvtColor(stored, cv2.COLOR_BGR2RGB).astype(float) - sheet()).mean() < 2, "make pictures"


def test_every_picture_is_shown_and_made() -> None:
    pages = "".join(page.read_text() for page in [ROOT / "README.md", *DOCS.rglob("*.md")])
    pictures = {path.name for path in DOCS.rglob("*") if path.suffix in (".png", ".svg", ".webp")}
    made = {name.rpartition("/")[2] for name in [*MADE, PHOTOGRAPH, PARTS, PAGE, FILM, STANCES]} | MEASURED
    assert {name for name in pictures if name not in pages} == set()
    assert pictures - made == set()
