"""Which nodes tree files may name: the project's own, and those of the user."""

from __future__ import annotations

import itertools
from pathlib import Path

import pytest

from bracket_cell.commands.main import main
from bracket_cell.trees.node_library import node_registry
from bracket_ground.errors import InputError

OWN = """
from btxml.engine.status import Status
from btxml.engine.node import Control, Decorator, Node
from bracket_cell.trees.nodes.moving import PickPart

class GentlePickPart(PickPart):
    "Picks more slowly."

class Base(Node):
    "Is only a base."
    abstract = True

class Leaf(Base):
    "A leaf."
    def update(self):
        return Status.SUCCESS

class Twice(Decorator):
    "A decorator."
    def run(self):
        return self.decorated.execute()

class Both(Control):
    "A control."
    def run(self):
        return Status.SUCCESS
"""
PORT = """
from btxml import InputPort, Node

class Own(Node):
    {} = InputPort(int, "a number", default="q")
"""
TREE = """<root BTCPP_format="4"><BehaviorTree ID="Main"><Both><Twice><Leaf/></Twice></Both></BehaviorTree></root>"""


def test_leaves_decorators_and_controls_of_a_file_are_found(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(OWN)
    added = set(node_registry(more=[str(file)]).classes) - set(node_registry().classes)
    assert added == {"GentlePickPart", "Leaf", "Twice", "Both"}
    assert "PickPart" in node_registry().classes


def test_check_takes_them_from_the_option_and_the_environment_and_runs_nothing_unasked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("mine.py").write_text(OWN)
    Path("tree.xml").write_text(TREE)
    assert main(["check", "tree.xml"]) == 2
    assert "there is no node 'Both'" in capsys.readouterr().err
    assert main(["check", "tree.xml", "--with", "mine.py"]) == 0
    Path("nodes").mkdir()
    Path("mine.py").rename("nodes/mine.py")
    with Path("nodes/mine.py").open("a") as file:
        file.write("\nfrom pathlib import Path\nPath('was_run').touch()\n")
    capsys.readouterr()
    assert main(["check", "tree.xml"]) == 2
    assert "nodes/ is not loaded: add --with nodes" in capsys.readouterr().err
    assert not Path("was_run").exists()
    assert main(["check", "tree.xml", "--with", "nodes"]) == 0
    assert Path("was_run").exists()
    monkeypatch.setenv("CELL_NODES", "nodes")
    assert main(["check", "tree.xml"]) == 0


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("no.py", None, "there is no such Python file"),
        ("no_such_package", None, "cannot be loaded: ModuleNotFoundError"),
        ("bad.py", "import nothing_at_all", "bad.py cannot be loaded: ModuleNotFoundError"),
        ("syntax.py", "def", "syntax.py cannot be loaded: SyntaxError"),
        ("leaves.py", "import sys\nsys.exit(0)", "leaves.py cannot be loaded: SystemExit"),
        (
            "same.py",
            OWN.replace("Leaf", "PickPart"),
            r"two node classes are named PickPart, in .*moving\.py and .*same\.py; rename one",
        ),
        ("port.py", PORT.format("name"), r"port\.py: Own has a port 'name', which is reserved"),
        ("value.py", PORT.format("n"), r"value\.py: the default of port 'n' of Own: 'q' is not an int; like 42"),
    ],
)
def test_what_cannot_be_loaded_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, text: str | None, message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    if text is not None:
        Path(name).write_text(text)
    with pytest.raises(InputError, match=message):
        node_registry(more=[name])


def test_check_knows_the_product_of_a_configuration(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    place = '<ReactiveSequence><WithoutGuard reason="test"/><PlacePart part="o1" position="p99"/></ReactiveSequence>'
    file = tmp_path / "tree.xml"
    file.write_text(f'<root BTCPP_format="4"><BehaviorTree ID="Main">{place}</BehaviorTree></root>')
    assert main(["check", str(file)]) == 0
    assert "checked with --config" in capsys.readouterr().err
    assert main(["check", str(file), "--config", "config/cell.yaml"]) == 2
    assert "the product has no position 'p99'; one of p1, p2" in capsys.readouterr().err


def test_notes_are_mistakes_where_that_is_asked_for(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "tree.xml"
    file.write_text('<root><BehaviorTree><AlwaysSuccess _collapsed="true"/></BehaviorTree></root>')
    assert main(["check", str(file)]) == 0
    assert f"{file}:1:36: note: '_collapsed' means nothing here; it is ignored" in capsys.readouterr().err
    assert main(["check", str(file), "--strict"]) == 2


def test_a_new_tree_and_a_new_leaf_come_with_tests_that_pass(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["new", "leaf", "CountParts"]) == 0
    assert main(["new", "tree", "TidyUp"]) == 0
    assert main(["check", "trees/tidy_up.xml", "--strict"]) == 0
    assert main(["new", "leaf", "CountParts"]) == 2  # nothing is overwritten
    assert main(["new", "leaf", "../oops"]) == 2
    assert [main(["new", "leaf", name]) for name in ("None", "Status")] == [2, 2], "no file could hold such a class"
    for command, taken in itertools.product(("leaf", "tree"), ("Sequence", "MoveTo", "SubTree")):
        assert main(["new", command, taken]) == 2
        assert f"there is a node '{taken}' already, at " in capsys.readouterr().err
    assert main(["new", "tree", "CountParts"]) == 2
    assert "count_parts.py" in capsys.readouterr().err
    for test in ("count_parts", "tidy_up"):
        scope: dict[str, object] = {}
        exec(Path(f"tests/test_{test}.py").read_text(), scope)  # as pytest would run it
        (run,) = [value for name, value in scope.items() if name.startswith("test_")]
        assert callable(run)
        run()
