"""What is installed is whole and pinned, and both halves of the tests run."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml
from packaging.requirements import Requirement

from tests import ROOT
from tests.processes import finished

PACKAGES = ("cell", "config", "learned", "sim", "skills", "trees")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
NO_TESTS = 5


LEFT_OUT = ("cell/lab/", "cell/commands/lab/", "learned/lab/")


def sources() -> set[str]:
    """Files of the packages in this clone, without the rooms of research."""
    found = (path for package in PACKAGES for path in (ROOT / package).rglob("*") if path.is_file())
    names = {path.relative_to(ROOT).as_posix() for path in found if "__pycache__" not in path.parts}
    return {name for name in names if not name.startswith(LEFT_OUT)}


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A wheel, built from a copy without network."""
    folder = tmp_path_factory.mktemp("source")
    for package in PACKAGES:
        shutil.copytree(ROOT / package, folder / package, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(ROOT / "docs", folder / "docs")
    shutil.copy(ROOT / "pyproject.toml", folder)
    build = "import sys; from setuptools import build_meta; build_meta.build_wheel(sys.argv[1])"
    told = finished([sys.executable, "-c", build, str(folder / "dist")], folder, {"PYTHONPATH": ""})
    assert told.returncode == 0, told.stderr
    return next((folder / "dist").iterdir())


def test_the_wheel_holds_every_file_of_the_packages_and_nothing_else(wheel: Path) -> None:
    inside = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
    guides = {name.partition("/share/doc/bracket-cell/")[2] for name in inside if ".data/" in name}
    assert guides == {path.relative_to(ROOT / "docs").as_posix() for path in (ROOT / "docs").rglob("*.md")}
    names = {name for name in inside if ".data/" not in name}
    assert names == sources()
    assert {"trees/assemble.xml", "config/gripper.dbc", "learned/weights/grasp_pairwise.onnx"} <= names


@pytest.mark.slow
def test_an_installed_cell_assembles_a_bracket_in_a_new_folder(wheel: Path, tmp_path: Path) -> None:
    """As a user does it, in a new environment and without the clone; downloads 0.3 GB."""
    program = tmp_path / "env" / "bin"
    nowhere = {"PYTHONPATH": "", "VIRTUAL_ENV": ""}
    for command in (
        [sys.executable, "-m", "venv", str(tmp_path / "env")],
        [str(program / "python"), "-m", "pip", "install", "-q", "-c", str(ROOT / "constraints.txt"), str(wheel)],
        [str(program / "cell"), "init", "demo"],
    ):
        told = finished(command, tmp_path, nowhere)
        assert told.returncode == 0, told.stderr
    demo = tmp_path / "demo"
    told = finished([str(program / "cell"), "run", "--goal", "g1", "--seed", "2", "--json"], demo, nowhere)
    assert told.returncode == 0, told.stderr
    assert '"correct": true' in told.stdout
    assert list((demo / "runs").glob("*.mcap"))
    for command in (
        [str(program / "cell"), "docs", "shift"],
        [str(program / "python"), "-m", "pip", "install", "-q", "-c", str(ROOT / "constraints.txt"), "pytest"],
        [str(program / "pytest"), "-q"],
    ):
        told = finished(command, demo, nowhere)
        assert told.returncode == 0, told.stdout + told.stderr


def test_constraints_pin_every_requirement_by_name_and_version_alone() -> None:
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    pinned = dict(line.split("==") for line in lines if not line.startswith("#"))
    assert all(re.fullmatch(r"[a-z0-9-]+==[\w.+!]+", f"{name}=={version}") for name, version in pinned.items())
    extras = PROJECT["project"]["optional-dependencies"].values()
    needed = [*PROJECT["project"]["dependencies"], *(one for extra in extras for one in extra)]
    needed += PROJECT["build-system"]["requires"]
    for requirement in map(Requirement, needed):
        name = requirement.name.lower().replace("_", "-")
        assert name in pinned, f"{name} is not pinned: make constraints"
        assert requirement.specifier.contains(pinned[name]), f"{name} {pinned[name]} is out of range: make constraints"


def test_make_verifies_the_files_of_every_pinned_package() -> None:
    first, *hashed = (ROOT / "constraints-hashed.txt").read_text().replace(" \\\n    --", " --").splitlines()
    assert first.startswith("#")
    assert all(re.fullmatch(r"\S+==\S+( --hash=sha256:[0-9a-f]{64})+", line) for line in hashed)
    plain = (ROOT / "constraints.txt").read_text().splitlines()[1:]
    assert [line.split()[0] for line in hashed] == plain, "make constraints"
    assert "--constraints constraints-hashed.txt" in (ROOT / "Makefile").read_text()


def test_what_nothing_imports_is_not_pinned() -> None:
    text = (ROOT / "constraints.txt").read_text()
    left_out = [Requirement(one).name for one in PROJECT["tool"]["uv"]["override-dependencies"]]
    assert "meshcat" in left_out
    assert not [name for name in (*left_out, "ipython", "pyngrok") if f"\n{name}==" in text]


@pytest.fixture
def suite(tmp_path: Path) -> Path:
    """A folder with one test for each half, which fail where a file says so."""
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers = torch\n")
    (tmp_path / "test_one.py").write_text(
        "import pathlib, pytest\n"
        "def fails(name): return pathlib.Path(name).exists()\n"
        "def test_plain(): assert not fails('plain')\n"
        "@pytest.mark.torch\n"
        "def test_torch(): assert not fails('torch')\n"
    )
    return tmp_path


def run_suite(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [str(ROOT / ".ci" / "test"), sys.executable, "test", "", "0", *arguments]
    alone = {"PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1", "PYTEST_PLUGINS": "xdist.plugin"}  # others take seconds to load
    return finished(command, folder, {"JUNIT": "reports", **alone})


@pytest.mark.parametrize("failing", [[], ["plain"], ["torch"], ["plain", "torch"]])
def test_one_half_that_fails_does_not_hide_the_other(failing: list[str], suite: Path) -> None:
    for name in failing:
        (suite / name).touch()
    told = run_suite(suite)
    assert (told.returncode == 0) == (not failing)
    words = {True: "FAILED (status 1)", False: "passed"}
    assert f"without torch: {words['plain' in failing]}; tests with torch: {words['torch' in failing]}" in told.stdout
    for name, half in (("test.xml", "plain"), ("test-torch.xml", "torch")):
        (case,) = ElementTree.parse(suite / "reports" / name).getroot().iter("testcase")
        assert case.get("name") == f"test_{half}"
        assert (case.find("failure") is not None) == (half in failing)


def test_tests_of_one_half_may_be_chosen_and_none_is_a_failure(suite: Path) -> None:
    assert run_suite(suite, "-k", "torch").returncode == 0
    assert run_suite(suite, "-k", "plain").returncode == 0
    assert run_suite(suite, "-k", "nothing").returncode == NO_TESTS


def test_the_example_of_a_workflow_calls_what_there_is() -> None:
    workflow = yaml.safe_load((ROOT / "docs" / "ci-example.yml").read_text())
    lines = [step["run"] for step in workflow["jobs"]["tests"]["steps"] if "run" in step]
    made = (ROOT / "Makefile").read_text()
    for line in lines:
        if line.startswith("make "):
            assert f"\n{line.split()[1]}: " in made
    packages = re.search(r"SYSTEM_PACKAGES := (.*)", made)
    assert packages is not None
    assert any(packages[1] in line for line in lines), "the packages that make would install as root"


def test_the_container_has_what_make_would_install_as_root_and_no_environment_of_the_clone() -> None:
    text = (ROOT / ".devcontainer" / "Containerfile").read_text()
    packages = re.search(r"SYSTEM_PACKAGES := (.*)", (ROOT / "Makefile").read_text())
    assert packages is not None
    assert packages[1] in text
    assert text.index("\nUSER cell\n") < text.index("RUN make")
    assert ".venv" in (ROOT / ".dockerignore").read_text().splitlines()
    told = json.loads((ROOT / ".devcontainer" / "devcontainer.json").read_text())
    assert (ROOT / ".devcontainer" / told["build"]["dockerfile"]).is_file()


def test_an_installation_that_was_broken_off_is_made_anew(tmp_path: Path) -> None:
    shutil.copy(ROOT / "Makefile", tmp_path)
    (tmp_path / ".venv" / "lib").mkdir(parents=True)
    assert "anew" not in finished(["make", "help"], tmp_path).stdout
    assert (tmp_path / ".venv" / "lib").exists()
    (tmp_path / ".venv" / "unfinished").touch()
    assert ".venv is made anew" in finished(["make", "help"], tmp_path).stdout
    assert not (tmp_path / ".venv").exists()


@pytest.mark.parametrize(
    ("environment", "words"),
    [
        ({"MUJOCO_GL": "elg"}, "the environment variable MUJOCO_GL is 'elg'; legal: egl, osmesa, glfw"),
        ({"__EGL_VENDOR_LIBRARY_DIRS": "/none"}, "apt-get install -y libegl1"),
    ],
)
def test_where_nothing_renders_a_run_says_so_in_one_line(
    tmp_path: Path, environment: dict[str, str], words: str
) -> None:
    command = [sys.executable, "-m", "cell", "run", "--log", str(tmp_path / "x.mcap")]
    told = finished(command, environment=environment)
    assert told.returncode in (2, 3)
    assert words in told.stderr.splitlines()[-1]
    assert "Traceback" not in told.stderr
