"""Training data that a training makes for itself: once, and anew where it was interrupted."""

from __future__ import annotations

from pathlib import Path

import pytest

from cell.commands.made_data import make_data
from cell.interfaces.errors import InputError


def test_data_are_made_once_and_what_was_interrupted_is_made_anew(tmp_path: Path) -> None:
    folder = tmp_path / "some"
    unfinished = tmp_path / "some.unfinished"
    unfinished.mkdir()
    (unfinished / "half.jsonl").write_text("{")
    options = {"--look": "nominal", "--recordings": 1, "--first-seed": 3}
    make_data("actions", folder, options, "--thin")
    assert (folder / "manifest.json").exists()
    assert not unfinished.exists()
    assert not (folder / "half.jsonl").exists()
    made = (folder / "manifest.json").stat().st_mtime_ns
    make_data("actions", folder, options, "--thin")
    assert (folder / "manifest.json").stat().st_mtime_ns == made


def test_what_the_command_said_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no look 'moonlight'"):
        make_data("hands", tmp_path / "some", {"--look": "moonlight"})
