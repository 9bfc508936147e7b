"""The examples of docs/authoring.md and docs/leaves.md: clean files that check, and tests that pass."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from types import ModuleType

import pytest

from bracket_cell.commands.init import new_cell
from bracket_cell.trees import Bench
from bracket_cell.trees.node_library import node_registry
from bracket_ground.files.files import write_new
from btxml.files.check import check
from tests import ROOT

BLOCK = re.compile(r"```(xml|python)\n(?:<!-- (.*?) -->|# (.*?\.py))\n(.*?)```", re.DOTALL)
PAGES = "".join((ROOT / "docs" / page).read_text() for page in ("authoring.md", "leaves.md"))
FILES = {xml or python: text for _, xml, python, text in BLOCK.findall(PAGES)}
TREES = [name for name in FILES if name.endswith(".xml")]
MODULES = [name for name in FILES if name.endswith(".py")]


def module_name(file: str) -> str:
    return file.removesuffix(".py").replace("/", ".")


def guide_tests(file: str) -> dict[str, Callable[[], None]]:
    module = ModuleType(module_name(file))
    sys.modules[module.__name__] = module  # where the classes that it defines say that they stand
    exec(compile(FILES[file], f"docs: {file}", "exec"), module.__dict__)
    return {name: value for name, value in vars(module).items() if name.startswith("test_") and callable(value)}


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the shipped trees and the guide's own, in which its examples run and its leaf can be imported."""
    shutil.copytree(ROOT / "trees", tmp_path / "trees", ignore=shutil.ignore_patterns("*.py", "nodes"))
    shutil.copytree(ROOT / "config", tmp_path / "config", ignore=shutil.ignore_patterns("*.py"))
    for name in TREES:
        (tmp_path / name).write_text(FILES[name])
    for file in [name for name in MODULES if name.startswith("nodes/")]:
        node = ModuleType(module_name(file))
        exec(compile(FILES[file], "docs/leaves.md", "exec"), node.__dict__)
        monkeypatch.setitem(sys.modules, node.__name__, node)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.long
def test_the_examples_run_as_printed_in_the_folder_of_cell_init(tmp_path: Path) -> None:
    write_new(tmp_path, new_cell())
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    (tmp_path / "script.py").write_text("from bracket_cell.trees import Bench\nfrom nodes.every_nth import EveryNth\n")
    # -P as in the program `pytest`, which does not look for modules in the working folder
    words = ["-P", "-m", "pytest", "-q", "-p", "no:cacheprovider", "-m", "not slow"]
    for arguments in (words, ["script.py"]):
        ended = subprocess.run([sys.executable, *arguments], cwd=tmp_path, capture_output=True, text=True)
        assert ended.returncode == 0, ended.stdout + ended.stderr


def named_tests(slow: bool) -> list[tuple[str, str]]:
    files = [file for file in MODULES if ("pytest.mark.slow" in FILES[file]) == slow]
    return [(file, name) for file in files for name in re.findall(r"^def (test_\w+)", FILES[file], re.MULTILINE)]


def test_the_guide_has_examples_of_each_kind() -> None:
    assert TREES
    assert "nodes/every_nth.py" in MODULES
    assert len(named_tests(slow=False)) >= 3
    assert len(named_tests(slow=True)) == 1


def test_trees_of_the_guide_have_no_mistakes(checkout: Path) -> None:
    assert check(sorted((checkout / "trees").glob("*.xml")), node_registry()) == []


@pytest.mark.parametrize("command", [["check"], ["format", "--check"]])
def test_python_of_the_guide_passes_make_check(command: list[str], tmp_path: Path) -> None:
    for name in MODULES:
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(FILES[name])
    names = ("", "ground", "engine", "cell", "sim", "lab")
    sources = f"src = {[str(tmp_path), *(str(ROOT / name) for name in names)]}"  # imports are sorted as in the clone
    settings = ["--no-cache", "--config", str(ROOT / "pyproject.toml"), "--config", sources]
    ruff = [sys.executable, "-m", "ruff", *command, *settings, str(tmp_path)]
    done = subprocess.run(ruff, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize(("file", "name"), named_tests(slow=False))
@pytest.mark.usefixtures("checkout")
def test_tests_of_the_guide_pass(file: str, name: str) -> None:
    guide_tests(file)[name]()


@pytest.mark.slow
@pytest.mark.parametrize(("file", "name"), named_tests(slow=True))
@pytest.mark.usefixtures("checkout")
def test_tests_of_the_guide_on_the_simulated_cell_pass(file: str, name: str) -> None:
    guide_tests(file)[name]()


class Stock(BaseHTTPRequestHandler):
    """Has seven of everything."""

    def do_GET(self) -> None:
        self.send_response(200)
        self.end_headers()
        self.wfile.write(b"7")

    def log_message(self, *_: object) -> None:
        pass


def test_the_leaf_of_the_guide_asks_a_server() -> None:
    with ThreadingHTTPServer(("127.0.0.1", 0), Stock) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        module = ModuleType("nodes.ask_stock")
        text = FILES["nodes/ask_stock.py"]
        assert len(text.splitlines()) - text.count("\n\n") <= 20
        exec(compile(text.replace("8080", str(server.server_port)), "docs/leaves.md", "exec"), module.__dict__)
        asks = module.__dict__["AskStock"]
        bench = Bench(asks(part="o1", result="{left}"), real=[asks])
        while bench.tick() == "R":
            threading.Event().wait(0.001)
        assert bench.tree.blackboard.entry("left").value == 7
        server.shutdown()
