"""The promised names: what users import; everything else may move."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import bracket_cell as cell
import btxml
from bracket_cell import trees
from btxml.files.compile.registry import BUILT_IN
from tests import ROOT

CELL = {
    "Arm",
    "ArmState",
    "Camera",
    "CellError",
    "Clock",
    "Command",
    "Connection",
    "DeviceFault",
    "Devices",
    "Display",
    "Frame",
    "Gripper",
    "GripperCommand",
    "GripperState",
    "JointSamples",
    "JointTrajectory",
    "Link",
    "ObjectStatus",
    "Observation",
    "Panel",
    "Pose",
    "RobotModel",
    "Sample",
    "Signals",
    "StreamingArm",
    "__version__",
    "load_cell",
    "replay",
    "run",
}
TREES = {
    *("Bench", "Control", "Decorator", "InOutPort", "InputPort", "Node", "NodeError", "OutputPort", "Outside"),
    *("PyTreesLeaf", "Status", "SubTree", "Traits", "Tree", "as_py_trees", "load_tree", "tree"),
    *(node.__name__ for node in BUILT_IN),
}


def test_the_front_door_hands_on_what_was_promised() -> None:
    assert (set(cell.__all__), set(btxml.__all__)) == (CELL, TREES)
    for package in (cell, btxml, trees):
        assert all(getattr(package, name) is not None for name in package.__all__)
        assert set(package.__all__) <= set(dir(package))


def test_a_name_that_is_not_there_is_refused_with_those_that_are() -> None:
    with pytest.raises(AttributeError, match="module 'bracket_cell' has no attribute 'Gripr'; it offers Arm, ArmState"):
        cell.Gripr  # noqa: B018


def test_nothing_is_loaded_before_it_is_asked_for() -> None:
    code = (
        "import bracket_cell, btxml, bracket_cell.trees, sys;"
        "print(*(n for n in ('numpy', 'mujoco', 'py_trees', 'pydantic') if n in sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.strip() == ""


@pytest.mark.parametrize("package", ["ground/bracket_ground", "engine/btxml", "cell/bracket_cell", "sim/bracket_sim"])
def test_packages_say_that_they_are_typed(package: str) -> None:
    assert (ROOT / package / "py.typed").is_file()


def test_a_run_and_its_replay_take_ten_lines(tmp_path: Path) -> None:
    from bracket_cell import load_cell, replay, run

    bench = load_cell("config/cell.yaml")
    tree = tmp_path / "short.xml"
    tree.write_text('<root BTCPP_format="4"><BehaviorTree ID="M"><Sleep msec="200"/></BehaviorTree></root>')
    result = run(bench, tree=tree, log=tmp_path / "run.mcap", goal="g0", seed=3)
    assert result.summary["finished"]
    assert list(replay(tmp_path / "run.mcap")) == []
    other = tmp_path / "longer.xml"
    other.write_text(tree.read_text().replace("200", "300"))
    assert [(difference.was, difference.now) for difference in replay(tmp_path / "run.mcap", tree=other)]
