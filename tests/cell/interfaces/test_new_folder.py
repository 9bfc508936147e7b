"""A new folder is there whole or not at all, and nothing of anybody's is removed for it."""

from __future__ import annotations

from pathlib import Path

import pytest

from bracket_ground.errors import InputError
from bracket_ground.files.files import UNFINISHED, whole_folder


def fill(path: Path, error: type[BaseException] | None = None) -> None:
    """Write a folder, or half of it."""
    with whole_folder(path) as partial:
        (partial / "images").mkdir()
        (partial / "images" / "1.png").write_text("image")
        assert not (path / "images").exists()
        if error is not None:
            raise error
        (partial / "manifest.json").write_text("{}")


@pytest.mark.parametrize("empty", [False, True])
def test_what_is_written_is_there_at_the_end(tmp_path: Path, empty: bool) -> None:
    path = tmp_path / "some" / "new"
    if empty:
        path.mkdir(parents=True)
    fill(path)
    assert sorted(file.name for file in path.rglob("*")) == ["1.png", "images", "manifest.json"]


@pytest.mark.parametrize("error", [KeyboardInterrupt, InputError])
@pytest.mark.parametrize("empty", [False, True])
def test_interrupted_it_leaves_nothing(tmp_path: Path, empty: bool, error: type[BaseException]) -> None:
    path = tmp_path / "new"
    if empty:
        path.mkdir()
    with pytest.raises(error):
        fill(path, error)
    assert list(tmp_path.rglob("*")) == [path] * empty


def test_what_a_killed_command_left_is_removed_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "new"
    (path / UNFINISHED).mkdir(parents=True)
    (path / UNFINISHED / "half.jsonl").write_text("{")
    fill(path)
    assert not (path / UNFINISHED).exists()
    with pytest.raises(InputError, match="new: is not an empty folder; remove it, or choose another --out"):
        fill(path)
    assert (path / "images" / "1.png").read_text() == "image"
    (tmp_path / "file").write_text("mine")
    with pytest.raises(InputError, match="file: is not an empty folder"):
        fill(tmp_path / "file")
    with pytest.raises(InputError, match="in: cannot be written"):
        fill(tmp_path / "file" / "in")
