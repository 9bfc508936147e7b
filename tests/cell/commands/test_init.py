"""`cell init`: the folder runs at once, and nothing that was there is touched."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from bracket_cell.commands.main import main
from tests.processes import finished

FILES = {
    ".vscode/settings.json",
    "AGENTS.md",
    "README.md",
    "config/cell.yaml",
    "config/products.yaml",
    "config/products_steel.yaml",
    "config/schema/cell.json",
    "config/schema/faults.json",
    "config/schema/gripper.json",
    "config/schema/look.json",
    "config/schema/person.json",
    "config/schema/products.json",
    "config/schema/robot.json",
    "config/schema/sim.json",
    "config/schema/trees.xsd",
    "config/sim.yaml",
    "pyproject.toml",
    "tests/test_assemble.py",
    "trees/ahead.xml",
    "trees/algorithm1.xml",
    "trees/assemble.xml",
    "trees/assembly.rules.yaml",
    "trees/clear_and_grasp.xml",
    "trees/shift.xml",
    "trees/shift_ahead.xml",
}


def files_of(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def in_folder(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """A command of this clone's program, called in another folder."""
    alone = {"PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}  # plugins take seconds to load
    environment = {"PYTHONDONTWRITEBYTECODE": "1", **alone}
    return finished([sys.executable, "-m", *arguments], folder, environment)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    assert main(["init", str(tmp_path / "demo")]) == 0
    return tmp_path / "demo"


def test_it_makes_configuration_product_tree_and_test(folder: Path) -> None:
    assert set(files_of(folder)) == FILES


def test_nothing_is_overwritten(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "trees" / "assemble.xml").write_text("mine")
    (folder / "README.md").unlink()
    before = files_of(folder)
    capsys.readouterr()
    assert main(["init", str(folder)]) == 2
    told = capsys.readouterr().err
    assert f"{folder / 'trees' / 'assemble.xml'}: exists already" in told
    assert "README.md" not in told
    assert files_of(folder) == before


def test_a_folder_that_is_complete_is_told_in_a_line(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    assert main(["init", str(folder)]) == 2
    assert capsys.readouterr().err == f"cell: {folder}: holds all of these files already; choose another folder\n"


@pytest.mark.parametrize(
    "words",
    [
        ["init", ""],
        ["schema", ""],
        ["run", "--log="],
        ["report", ""],
        ["show", "a", "--png", "-"],
        ["log", "export", "a", "-o-"],
    ],
)
def test_an_argument_that_names_nothing_is_neither_the_working_folder_nor_a_file(
    words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(words) == 2
    assert "names nothing; name a file" in capsys.readouterr().err
    assert not files_of(tmp_path)


@pytest.mark.parametrize("name", ["demo", "demo/tests"])
def test_a_file_where_a_folder_should_be_is_told(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    path.write_text("mine")
    assert main(["init", str(tmp_path / "demo")]) == 2
    assert f"{path}: exists already" in capsys.readouterr().err
    assert files_of(tmp_path) == {name: b"mine"}


@pytest.mark.long
def test_its_tests_pass_without_a_warning_and_can_fail(folder: Path) -> None:
    slow = "import pytest\n\n\n@pytest.mark.slow\ndef test_in_simulation() -> None: ...\n"
    (folder / "tests" / "test_slow.py").write_text(slow)  # as docs/authoring.md marks them
    whole = in_folder(folder, "pytest", "-q", "-p", "no:cacheprovider")
    assert whole.returncode == 0, whole.stdout
    assert "4 passed" in whole.stdout
    assert "warning" not in whole.stdout.lower()
    tree = folder / "trees" / "assemble.xml"
    tree.write_text(tree.read_text().replace("<ActivateGripper/>", "<ActivateGriper/>"))
    assert in_folder(folder, "pytest", "-x", "-q", "-p", "no:cacheprovider").returncode == 1


def test_commands_take_the_files_of_the_working_folder(folder: Path) -> None:
    """Proof by mistakes: one in the folder's configuration, then one in its tree, end a run without options."""
    configuration, tree = folder / "config" / "cell.yaml", folder / "trees" / "assemble.xml"
    sound = configuration.read_text()
    configuration.write_text(sound.replace("tick_hz:", "tick_hs:"))
    told = in_folder(folder, "bracket_cell", "run")
    assert told.returncode == 2
    line = next(number for number, text in enumerate(sound.splitlines(), 1) if "tick_hz:" in text)
    assert f"config/cell.yaml:{line}:3: unknown key 'tick_hs'" in told.stderr
    configuration.write_text(sound)
    tree.write_text(tree.read_text().replace("<ActivateGripper/>", "<ActivateGriper/>"))
    told = in_folder(folder, "bracket_cell", "run")
    assert told.returncode == 2
    assert f"{tree}:11:7: there is no node 'ActivateGriper'" in told.stderr
    assert set(files_of(folder)) == FILES, "no log is left"


def test_without_files_of_ones_own_the_shipped_ones_are_taken(tmp_path: Path) -> None:
    told = in_folder(tmp_path, "bracket_cell", "run", "--goal", "g9")
    assert (told.returncode, list(tmp_path.rglob("*.mcap"))) == (2, [])
    assert "unknown goal 'g9'" in told.stderr


@pytest.mark.slow
def test_a_bracket_is_assembled_and_the_log_lies_in_the_folder(folder: Path) -> None:
    told = in_folder(folder, "bracket_cell", "run", "--goal", "g1", "--seed", "2", "--json")
    assert told.returncode == 0, told.stderr
    assert '"correct": true' in told.stdout
    assert [path.suffix for path in sorted((folder / "runs").iterdir())] == [".mcap", ".png"]


def test_any_name_of_a_folder_is_told_as_it_is(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Square brackets were taken for a style: "[/b]" ended in a traceback."""
    folder = tmp_path / "a [/b] [red]c"
    assert main(["init", str(folder)]) == 0
    said = capsys.readouterr().err.splitlines()
    assert f"{folder}/config/cell.yaml" in said
    assert said[-1] == f"next: cd '{folder}' && cell run"


@pytest.mark.usefixtures("small_files")
def test_a_full_disk_leaves_nothing_behind(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A second try was refused, as some of the files were there already."""
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").write_text("kept")
    for folder in (tmp_path / "mine", tmp_path / "new" / "cell"):
        assert main(["init", str(folder)]) == 2
        assert "cannot be written" in capsys.readouterr().err
    assert [path.name for path in tmp_path.rglob("*")] == ["mine", "notes.txt"]


def test_schemas_alone_are_renewed_after_an_update(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = files_of(folder)
    (folder / "config" / "schema" / "look.json").write_text('{"$comment": "made by cell schema; do not edit"}')
    monkeypatch.chdir(folder)
    assert main(["schema"]) == 0
    assert files_of(folder) == before
