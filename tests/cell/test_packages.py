"""What is installed and whole, and how an extra is got."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from bracket_cell.packages import (
    LABORATORY,
    damaged_packages,
    how_to_install,
    install_command,
    missing_packages,
    needed,
)
from bracket_ground.errors import InputError


@pytest.fixture
def half(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package of two files, alone on the path: to look at all that are installed takes seconds."""
    info = tmp_path / "half-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: half\nVersion: 1.0\n")
    (info / "RECORD").write_text("half/__init__.py,sha256=x,4\nhalf/more.py,sha256=x,2\nhalf-1.0.dist-info/RECORD,,\n")
    (tmp_path / "half").mkdir()
    (tmp_path / "half" / "__init__.py").write_text("a=1\n")
    (tmp_path / "half" / "more.py").write_text("b\n")
    monkeypatch.setattr(sys, "path", [str(tmp_path)])
    return tmp_path / "half"


def test_a_package_that_was_half_unpacked_is_named_with_the_file(half: Path) -> None:
    assert "half" not in damaged_packages()
    (half / "more.py").write_text("")
    assert damaged_packages()["half"] == "half/more.py has 0 bytes, not 2"
    (half / "more.py").unlink()
    assert damaged_packages()["half"] == "half/more.py is missing"


def test_all_packages_of_what_is_installed_are_there() -> None:
    names, missing = missing_packages()
    assert {"mujoco", "pin", "pydantic"} <= set(names)
    assert not missing


@pytest.fixture
def installed_from(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A clone with what a build leaves in it, found before the installed package's own entry."""
    clone, site = tmp_path / "clone" / "cell", tmp_path / "site"
    left, installed = clone / "bracket_cell.egg-info", site / "bracket_cell-1.dist-info"
    for folder, name in ((left, "PKG-INFO"), (installed, "METADATA")):
        folder.mkdir(parents=True)
        (folder / name).write_text("Metadata-Version: 2.1\nName: bracket-cell\nVersion: 1\n")
    (installed / "direct_url.json").write_text(json.dumps({"url": clone.as_uri(), "dir_info": {"editable": True}}))
    monkeypatch.setattr(sys, "path", [str(clone), str(site), *sys.path])
    return clone


@pytest.mark.parametrize(("extra", "folder"), [("fleet", "cell"), ("gym", "sim"), ("stacks", "lab")])
def test_an_extra_is_got_from_where_the_project_came_from_and_never_by_a_bare_name(
    extra: str, folder: str, installed_from: Path
) -> None:
    with pytest.raises(InputError, match="tables needs the package nowhere") as told:
        needed("nowhere.at_all", "tables", extra)
    assert str(told.value).endswith(f'pip install -e "{installed_from.with_name(folder)}[{extra}]"')


def test_an_extra_of_a_project_that_came_from_nowhere_says_clone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.metadata.distributions", lambda **_: iter(()))
    assert install_command(extra="fleet").endswith('pip install "CLONE/cell[fleet]"')


def test_the_laboratory_is_got_by_make_in_a_clone_alone(installed_from: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert how_to_install(LABORATORY) == "make train-deps"
    monkeypatch.setattr("bracket_cell.packages.INSTALLED", installed_from)
    assert how_to_install(LABORATORY).endswith(f'pip install -e "{installed_from.with_name("lab")}"')
