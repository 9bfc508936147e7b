"""Photographs by source and licence: a source is learned from or kept for the scores, never both."""

from __future__ import annotations

from pathlib import Path

import pytest

from bracket_cell.learned.hands.records import FrameRow
from bracket_ground.errors import InputError
from bracket_lab.commands.training.networks import _kept
from bracket_lab.commands.training.weights import Training
from bracket_lab.learned.hands.data import LabelledFrame
from bracket_lab.pictures.origins import NOT_RECORDED, WITHOUT_HANDS, Photograph, by_source, photographs_of

LICENCES = """
version = 1
[[annotations]]
path = "gestures/**"
SPDX-FileCopyrightText = "2024 Jane Doe"
SPDX-License-Identifier = "CC-BY-4.0"
[[annotations]]
path = ["gestures/*.jpg", "stills/a b.png"]
SPDX-License-Identifier = ["CC0-1.0", "MIT"]
"""


def folder(path: Path, licences: str, *names: str) -> Path:
    for name in names:
        (path / name).parent.mkdir(parents=True, exist_ok=True)
        (path / name).write_bytes(b"")
    (path / "REUSE.toml").write_text(licences)
    return path


def test_licences_are_those_of_reuse_and_sources_the_folders(tmp_path: Path) -> None:
    names = "gestures/1.jpg", "gestures/deep/2.jpg", "gestures/3.png", "stills/a b.png", "stills/aXb.png", "own.png"
    found = photographs_of(folder(tmp_path / "hands", LICENCES, *names))
    told = {each.file.relative_to(tmp_path / "hands").as_posix(): (each.source, each.licence) for each in found}
    assert told == {
        "gestures/1.jpg": ("gestures", "CC0-1.0 AND MIT"),
        "gestures/deep/2.jpg": ("gestures", "CC-BY-4.0"),
        "gestures/3.png": ("gestures", "CC-BY-4.0"),
        "stills/a b.png": ("stills", "CC0-1.0 AND MIT"),
        "stills/aXb.png": ("stills", NOT_RECORDED),
        "own.png": ("hands", NOT_RECORDED),
    }
    assert by_source((each.source, each.licence) for each in found)["gestures"] == "2 (CC-BY-4.0), 1 (CC0-1.0 AND MIT)"


@pytest.mark.parametrize(
    ("licences", "told"),
    [
        ("version = ]", r"REUSE\.toml: is no TOML: .*line 1"),
        ("annotations = 3", r"REUSE\.toml: annotations: input should be a list; legal: \[\[annotations\]\]"),
        ('[[annotations]]\nSPDX-License-Identifier = "MIT"', r"REUSE\.toml: annotations\.0\.path: .*; legal: "),
        ("[[annotations]]\npath = 3", r"REUSE\.toml: annotations\.0\.path"),
    ],
)
def test_wrong_licences_are_refused_in_words(tmp_path: Path, licences: str, told: str) -> None:
    with pytest.raises(InputError, match=told) as refused:
        photographs_of(folder(tmp_path, licences, "1.png"))
    assert "pydantic" not in str(refused.value)


def frames(*origins: str, logs: int = 4) -> list[LabelledFrame]:
    """Of photographs of sources."""
    rows = [
        FrameRow(file="x.jpg", log=f"photograph-{number:05d}", hands=(), source=origin)  # as of folders of their own
        for origin in origins
        for number in range(logs)
    ]
    return [LabelledFrame(row, Path("x.jpg")) for row in rows]


@pytest.mark.parametrize("seed", range(5))
def test_a_source_is_learned_from_or_kept_and_some_of_either_kind_is_learned_from(tmp_path: Path, seed: int) -> None:
    own = frames("a", "b", "c", f"d{WITHOUT_HANDS}", f"e{WITHOUT_HANDS}", f"f{WITHOUT_HANDS}")
    kept = _kept(own, Training(out=tmp_path / "w.onnx", seed=seed))
    sources = [{frame.row.source for frame in own if (frame.row.origin in kept) is side} for side in (True, False)]
    assert not sources[0] & sources[1]
    assert all({name.endswith(WITHOUT_HANDS) for name in side} == {True, False} for side in sources)


def test_one_source_alone_is_learned_from_whole_and_scored_on_simulated_hands(tmp_path: Path) -> None:
    own = frames("a", f"d{WITHOUT_HANDS}")
    assert _kept(own, Training(out=tmp_path / "w.onnx", simulated=True)) == set()
    with pytest.raises(InputError, match="1 recording or source alone"):
        _kept(own, Training(out=tmp_path / "w.onnx"))


def test_photographs_that_nobody_told_of_are_not_recorded() -> None:
    assert Photograph(Path("x.png")).licence == NOT_RECORDED
