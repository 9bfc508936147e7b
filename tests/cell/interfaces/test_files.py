"""Shipped files are found whatever folders the user has."""

from __future__ import annotations

import sys
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType

import pytest

from bracket_ground.files.files import shipped, user_or_packaged, whole_or_none


def test_folders_of_the_user_do_not_hide_what_is_shipped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "config").mkdir()
    mine = ModuleType("config")
    mine.__path__ = [str(tmp_path / "config")]
    mine.__spec__ = ModuleSpec("config", None, is_package=True)
    mine.__spec__.submodule_search_locations = mine.__path__
    monkeypatch.setitem(sys.modules, "config", mine)
    assert shipped("bracket_cell.config", "gripper.dbc").is_file()
    assert shipped("bracket_cell.commands", "new_cell", "README.md").is_file()


def test_a_file_of_the_working_folder_comes_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "config").mkdir()
    (tmp_path / "config" / "cell.yaml").write_text("")
    monkeypatch.chdir(tmp_path)
    assert user_or_packaged("bracket_cell.config", "cell.yaml") == tmp_path / "config" / "cell.yaml"
    assert user_or_packaged("bracket_cell.config", "gripper.dbc") == shipped("bracket_cell.config", "gripper.dbc")


def fill_the_disk(path: Path) -> None:
    with whole_or_none(path) as partial:
        partial.write_text("ne")
        raise OSError("full")


def test_a_file_is_there_whole_or_not_at_all(tmp_path: Path) -> None:
    (tmp_path / "old.csv").write_text("old")
    (tmp_path / "link.csv").symlink_to("old.csv")
    for name in ("old.csv", "link.csv", "new"):
        with pytest.raises(OSError, match="full"):
            fill_the_disk(tmp_path / name)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["link.csv", "old.csv"]
    assert (tmp_path / "old.csv").read_text() == "old"
    with whole_or_none(tmp_path / "link.csv") as partial:
        partial.write_text("new")
    assert (tmp_path / "link.csv").is_symlink()
    assert (tmp_path / "old.csv").read_text() == "new"
    with whole_or_none(Path("/dev/null")) as partial:
        assert partial == Path("/dev/null")
