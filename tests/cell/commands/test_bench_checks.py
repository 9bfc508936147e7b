"""`cell check --config` tells of obstacles that stand where they cannot, and a run does not begin in one."""

from __future__ import annotations

from pathlib import Path

import pytest

from bracket_cell.commands.main import main
from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_cell.wiring.bench_checks import refuse_blocked
from bracket_ground.errors import SettingError
from tests import ROOT
from tests.cell.interfaces.test_obstacles import bench_with

TREE = str(ROOT / "trees" / "ahead.xml")


@pytest.mark.parametrize(
    ("obstacle", "words"),
    [
        (
            "{name: lamp, position_m: [0.56, -0.38, 0.1], box_m: [0.1, 0.1, 0.2]}",
            "warning: lamp and the tray overlap by",
        ),
        (
            "{name: lamp, position_m: [1.02, 0.34, 0.1], cylinder_m: [0.1, 0.2]}",
            "warning: lamp and the bin of o1 overlap",
        ),
        ("{name: lamp, position_m: [0.74, 0.05, 0.8], box_m: [0.3, 0.3, 0.1]}", "between the overhead camera and p"),
    ],
)
def test_what_is_doubtful_is_told_with_its_line(
    obstacle: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = bench_with(tmp_path, obstacle)
    assert main(["check", TREE, "--config", str(path)]) == 1
    told = capsys.readouterr().err
    assert words in told
    line = 1 + path.read_text().splitlines().index("  obstacles:")
    assert f"{path}:{line}" in told or f"{path}:{line + 1}" in told


def test_an_arm_that_rests_in_something_is_a_mistake(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = bench_with(tmp_path, "{name: lamp, position_m: [0.45, -0.50, 0.45], box_m: [0.1, 0.1, 0.3]}")
    assert main(["check", TREE, "--config", str(path)]) == 2
    told = capsys.readouterr().err
    assert f"{path}:" in told
    assert "the arm rests in something" in told
    assert "would touch lamp" in told
    configuration = load_configuration(path)
    with pytest.raises(SettingError, match="arm_park_rad"):
        refuse_blocked(MotionPlanner(load_product(configuration, path), configuration.bench, configuration.motion))
