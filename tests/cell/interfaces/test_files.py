"""Shipped files are found whatever folders the user has."""

from __future__ import annotations

import sys
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType

import pytest

from cell.interfaces.files import own_or_shipped, shipped


def test_folders_of_the_user_do_not_hide_what_is_shipped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "config").mkdir()
    mine = ModuleType("config")
    mine.__path__ = [str(tmp_path / "config")]
    mine.__spec__ = ModuleSpec("config", None, is_package=True)
    mine.__spec__.submodule_search_locations = mine.__path__
    monkeypatch.setitem(sys.modules, "config", mine)
    assert shipped("config", "gripper.dbc").is_file()
    assert shipped("cell.commands", "new_cell", "README.md").is_file()


def test_a_file_of_the_working_folder_comes_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "config").mkdir()
    (tmp_path / "config" / "cell.yaml").write_text("")
    monkeypatch.chdir(tmp_path)
    assert own_or_shipped("config", "cell.yaml") == tmp_path / "config" / "cell.yaml"
    assert own_or_shipped("config", "gripper.dbc") == shipped("config", "gripper.dbc")
