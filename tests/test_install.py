"""What is installed is whole and pinned, and both halves of the tests run."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from fnmatch import fnmatch
from itertools import chain
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml
from packaging.requirements import Requirement

from tests import ROOT
from tests.processes import finished

DISTRIBUTIONS = {
    "ground": "bracket_ground",
    "engine": "btxml",
    "cell": "bracket_cell",
    "sim": "bracket_sim",
    "lab": "bracket_lab",
}
RUNTIME = ("ground", "engine", "cell", "sim")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
MEMBERS = {folder: tomllib.loads((ROOT / folder / "pyproject.toml").read_text()) for folder in DISTRIBUTIONS}
NO_TESTS = 5
SHARED = shutil.ignore_patterns("__pycache__", "*.egg-info", "build")


def sources(folder: str) -> set[str]:
    """Files of a distribution's package in this clone, with the guides among those of the cell."""
    tracked = finished(["git", "ls-files", f"{folder}/{DISTRIBUTIONS[folder]}", "docs"], ROOT).stdout.split()
    guides = {f"bracket_cell/{name}" for name in tracked if name.startswith("docs/") and folder == "cell"}
    kinds = MEMBERS[folder]["tool"]["setuptools"]["package-data"]["*"]
    guides = {name for name in guides if any(fnmatch(name, kind) for kind in kinds)}
    return guides | {name.removeprefix(f"{folder}/") for name in tracked if (ROOT / name).is_file()} - {
        name for name in tracked if name.startswith("docs/")
    }


@pytest.fixture(scope="module")
def wheels(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A wheel of each distribution, built from copies without network."""
    folder, built = tmp_path_factory.mktemp("source"), {}
    for name in DISTRIBUTIONS:
        shutil.copytree(ROOT / name, folder / name, ignore=SHARED)
        build = "import sys; from setuptools import build_meta; build_meta.build_wheel(sys.argv[1])"
        told = finished([sys.executable, "-c", build, str(folder / name / "dist")], folder / name, {"PYTHONPATH": ""})
        assert told.returncode == 0, told.stderr
        built[name] = next((folder / name / "dist").iterdir())
    return built


@pytest.mark.long
@pytest.mark.parametrize("folder", DISTRIBUTIONS)
def test_a_wheel_holds_every_file_of_its_package_and_no_other_name(folder: str, wheels: dict[str, Path]) -> None:
    names = {name for name in zipfile.ZipFile(wheels[folder]).namelist() if ".dist-info/" not in name}
    assert names == sources(folder)
    assert {name.partition("/")[0] for name in names} == {DISTRIBUTIONS[folder]}


def test_the_wheel_of_the_cell_has_trees_weights_and_guides(wheels: dict[str, Path]) -> None:
    names = set(zipfile.ZipFile(wheels["cell"]).namelist())
    files = ("trees/assemble.xml", "config/gripper.dbc", "learned/weights/grasp_pairwise.onnx", "docs/shift.md")
    assert {f"bracket_cell/{name}" for name in files} <= names


def test_all_distributions_have_the_version_of_the_cell_and_ask_for_it() -> None:
    versions = {folder: member["project"]["version"] for folder, member in MEMBERS.items()}
    assert len(set(versions.values())) == 1, versions
    own = {member["project"]["name"] for member in MEMBERS.values()}
    asked = [Requirement(line) for member in MEMBERS.values() for line in member["project"]["dependencies"]]
    found = {str(requirement.specifier) for requirement in asked if requirement.name in own}
    assert found == {f"=={versions['cell']}"}


BLOCKED = """
import sys
class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {blocked!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, Absent())
import importlib.metadata as metadata
entry_points = metadata.entry_points
metadata.entry_points = lambda **asked: [one for one in entry_points(**asked) if one.dist.name not in {absent!r}]
"""


def without(*names: str) -> str:
    """Code that makes packages absent, with the distributions that bring them."""
    absent = tuple(MEMBERS[folder]["project"]["name"] for folder, name in DISTRIBUTIONS.items() if name in names)
    return BLOCKED.format(blocked=names, absent=absent)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What `cell init` makes: its configuration names the simulation."""
    folder = tmp_path_factory.mktemp("user")
    told = finished([sys.executable, "-m", "bracket_cell", "init", "cell"], folder)
    assert told.returncode == 0, told.stderr
    return folder / "cell"


@pytest.mark.long
@pytest.mark.parametrize(
    ("words", "status"),
    [
        (["check", "trees/ahead.xml"], 0),
        (["show", "trees/ahead.xml"], 0),
        (["replay", "CASE"], 0),
        (["nodes"], 0),
        (["safety", "show"], 1),
        (["--help"], 0),
        (["doctor", "--json"], 1),
        (["run"], 2),
        (["train"], 2),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else "",
)
def test_the_cell_alone_works_without_simulator_laboratory_mujoco_and_torch(
    words: list[str], status: int, made: Path
) -> None:
    case = next((ROOT / "tests" / "cases").glob("*.mcap"))
    typed = [str(case) if word == "CASE" else word for word in words]
    code = without("mujoco", "torch", "bracket_sim", "bracket_lab") + (
        f"from bracket_cell.commands.main import main; raise SystemExit(main({typed!r}))"
    )
    told = finished([sys.executable, "-c", code], made)
    assert "Traceback" not in told.stderr
    assert told.returncode == status, told.stdout + told.stderr
    assert status != 2 or "install it: " in told.stderr


def test_the_engine_and_the_ground_start_without_each_other_and_the_cell() -> None:
    for name in ("btxml", "bracket_ground"):
        others = sorted({*DISTRIBUTIONS.values(), "mujoco", "torch", "py_trees"} - {name})
        code = without(*others) + f"import {name}"
        told = finished([sys.executable, "-c", code])
        assert told.returncode == 0, told.stderr


@pytest.mark.long
def test_names_of_a_users_folder_hide_nothing(tmp_path: Path) -> None:
    """Modules and folders of general names beside a user's script, which stand first where Python looks."""
    for name in ("sim", "config", "skills", "learned", "cell", "engine", "ground", "lab"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('the user's own')\n")
    for name in ("trees", "nodes", "tests"):
        (tmp_path / name).mkdir()
    text = "from bracket_cell import load_cell\nfrom bracket_cell.trees import node_registry\nnode_registry()\n"
    (tmp_path / "script.py").write_text(text)
    (tmp_path / "test_script.py").write_text(f"{text}\ndef test_it(): pass\n")
    for command in (["script.py"], ["-m", "script"], ["-m", "pytest", "-q", "-p", "no:cacheprovider"]):
        told = finished([sys.executable, *command], tmp_path, {"PYTHONPATH": str(tmp_path)})
        assert told.returncode == 0, told.stdout + told.stderr


@pytest.mark.slow
def test_an_installed_cell_assembles_a_bracket_in_a_new_folder(wheels: dict[str, Path], tmp_path: Path) -> None:
    """As a user does it, in a new environment and without the clone; downloads 0.3 GB."""
    program = tmp_path / "env" / "bin"
    nowhere = {"PYTHONPATH": "", "VIRTUAL_ENV": ""}
    install = [str(program / "python"), "-m", "pip", "install", "-q", "-c", str(ROOT / "constraints.txt")]
    for command in (
        [sys.executable, "-m", "venv", str(tmp_path / "env")],
        [*install, *(str(wheels[name]) for name in RUNTIME)],
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
        [*install, "pytest"],
        [str(program / "pytest"), "-q"],
    ):
        told = finished(command, demo, nowhere)
        assert told.returncode == 0, told.stdout + told.stderr


def test_constraints_pin_every_requirement_by_name_and_version_alone() -> None:
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    pinned = dict(line.split("==") for line in lines if not line.startswith("#"))
    assert all(re.fullmatch(r"[a-z0-9-]+==[\w.+!]+", f"{name}=={version}") for name, version in pinned.items())
    needed = list(chain(*PROJECT["dependency-groups"].values()))
    for member in MEMBERS.values():
        needed += [*member["project"]["dependencies"], *member["build-system"]["requires"]]
        needed += chain(*member["project"].get("optional-dependencies", {}).values())
    own = {member["project"]["name"] for member in MEMBERS.values()}
    for requirement in map(Requirement, needed):
        if requirement.name in own:
            continue
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


@pytest.mark.long
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
    command = [sys.executable, "-m", "bracket_cell", "run", "--log", str(tmp_path / "x.mcap")]
    told = finished(command, environment=environment)
    assert told.returncode in (2, 3)
    assert words in told.stderr.splitlines()[-1]
    assert "Traceback" not in told.stderr
