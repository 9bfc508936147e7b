"""The first day of somebody who programs a cell: all that docs/authoring.md and docs/leaves.md tell them to do.

Every block is written, and every command is typed, in a folder that `cell init` made; then a second cell shares a
library with the first.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import threading
from pathlib import Path

import pytest

from tests import ROOT
from tests.docs.guide import Reader, Step, steps

PAGES = ("authoring.md", "leaves.md")
ENDLESS = """<root BTCPP_format="4" main_tree_to_execute="Mine">
  <BehaviorTree ID="Mine">
    <KeepRunningUntilFailure><AlwaysSuccess/></KeepRunningUntilFailure>
  </BehaviorTree>
</root>
"""
LIBRARY_TREE = """<root BTCPP_format="4">
  <BehaviorTree ID="Rest">
    <AtMost n="1">
      <MoveTo pose="park"/>
    </AtMost>
  </BehaviorTree>
</root>
"""
TREE = """<root BTCPP_format="4" main_tree_to_execute="Rests">
  <include path="../../library/trees/rest.xml"/>
  <BehaviorTree ID="Rests">
    <SubTree ID="Rest"/>
  </BehaviorTree>
</root>
"""
TREE_TEST = """from bracket_cell.trees import Bench
from bracket_cell.trees.node_library import node_registry


def test_the_arm_rests_once() -> None:
    shared = node_registry(more=["../library/nodes"]).classes["AtMost"]
    bench = Bench("trees/rests.xml", real=[shared])
    assert bench.tick() == "S"
    assert bench.tick() == "F"
"""


def typed(reader: Reader, line: str) -> str:
    """What a command printed."""
    reader.do(Step("console", line))
    return reader.printed


@pytest.fixture
def day(tmp_path: Path) -> Reader:
    """Somebody who has read both pages and done all that takes no simulator."""
    reader = Reader(tmp_path)
    typed(reader, "cell init one")
    typed(reader, "cd one")
    for page in PAGES:
        for step in steps(page):
            if "../library" in step.text:
                reader.do(step)
                told = typed(reader, "cell nodes  # status 2")
                assert "nodes '../library/nodes': there is no such file or folder" in told
                (reader.folder.parent / "library" / "nodes").mkdir(parents=True)
            reader.do(step)
    return reader


@pytest.mark.long
def test_a_first_day_typed_as_printed(day: Reader) -> None:
    assert "passed" in typed(day, 'pytest -m "not slow"')
    assert "AtMost" in typed(day, "cell nodes AtMost")
    assert "Let the child begin n times" in day.printed
    (day.folder / "trees" / "patient.xml").write_text(
        (day.folder / "trees" / "patient.xml").read_text().replace("RetryUntilSuccessful", "RetryUntilSucessful")
    )
    told = typed(day, "cell check trees/patient.xml  # status 2")
    assert "did you mean 'RetryUntilSuccessful'?" in told


@pytest.mark.long
def test_two_cells_share_a_library_of_nodes_and_trees(day: Reader) -> None:
    library = day.folder.parent / "library"
    (library / "trees").mkdir()
    shutil.move(day.folder / "nodes" / "at_most.py", library / "nodes" / "at_most.py")
    (library / "trees" / "rest.xml").write_text(LIBRARY_TREE)
    typed(day, "cd ..")
    typed(day, "cell init two")
    typed(day, "cd two")
    (libraries,) = [step for step in steps("leaves.md") if step.text.startswith("# config/cell.yaml")]
    day.do(libraries)
    for cell in ("one", "two"):
        day.folder = day.folder.parent / cell
        (day.folder / "trees" / "rests.xml").write_text(TREE)
        (day.folder / "tests" / "test_rests.py").write_text(TREE_TEST)
        typed(day, "cell check trees/rests.xml")
        assert "1 passed" in typed(day, "pytest tests/test_rests.py")
    wrong = library / "trees" / "rest.xml"
    wrong.write_text(LIBRARY_TREE.replace("AtMost", "AtMots"))
    told = typed(day, "cell check trees/rests.xml  # status 2")
    assert str(wrong) in told or "library/trees/rest.xml" in told
    assert "did you mean 'AtMost'?" in told


@pytest.mark.long
def test_a_tree_is_edited_while_it_runs(tmp_path: Path) -> None:
    """As docs/watching.md says: an edit with a mistake is refused, and a sound one takes over."""
    (line,) = re.findall(r"^    (cell run .*--watch.*)", (ROOT / "docs" / "watching.md").read_text(), re.MULTILINE)
    reader = Reader(tmp_path)
    typed(reader, "cell init one")
    typed(reader, "cd one")
    tree = reader.folder / "trees" / "mine.xml"
    tree.write_text(ENDLESS)
    with reader.begun(line) as run:
        until(run, "nothing seen yet")
        tree.write_text(ENDLESS.replace("AlwaysSuccess", "AlwaysSucess"))
        refused = until(run, "the edited tree is refused, the old one goes on")
        assert "did you mean 'AlwaysSuccess'?" in refused
        tree.write_text(ENDLESS.replace("KeepRunningUntilFailure", "Inverter").replace("Success", "Failure"))
        until(run, "the edited tree took over")
        until(run, "finished: the tree succeeded")
        assert run.wait(60) == 0


def until(run: subprocess.Popen[str], words: str) -> str:
    """The line with these words, once a command prints it; one that never does is ended."""
    assert run.stdout is not None
    read = []
    patience = threading.Timer(120, run.kill)
    patience.start()
    for line in run.stdout:
        read.append(line)
        if words in line:
            patience.cancel()
            return line
    raise AssertionError(f"{words!r} was never printed:\n{''.join(read)}")


@pytest.mark.slow
def test_the_tree_of_the_first_day_runs_in_simulation(day: Reader) -> None:
    assert "1 passed" in typed(day, "pytest -m slow tests/test_patient_in_simulation.py")
