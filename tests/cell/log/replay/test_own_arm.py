"""A log of an arm of one's own is replayed by what is in it."""

from __future__ import annotations

from pathlib import Path
from shutil import copy

import pytest

from bracket_cell.commands.main import main
from bracket_ground.interfaces.robot import FOLDER
from tests import ROOT
from tests.arms import NEARER, cell_file, robot_file


def test_a_run_of_an_arm_with_meshes_whose_resting_poses_were_found_is_repeated(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    urdf = robot_file(tmp_path, "seven").with_suffix(".urdf")
    copy(FOLDER / "ur10" / "collision" / "wrist3.stl", tmp_path / "own.stl")
    shape = '<collision><geometry><mesh filename="own.stl"/></geometry></collision></link><joint name="ax3"'
    urdf.write_text(urdf.read_text().replace('</link><joint name="ax3"', shape, 1))
    config = cell_file(tmp_path, "seven.yaml", {**NEARER, "max_duration_s: 300.0": "max_duration_s: 1.0"})
    log = tmp_path / "log.mcap"
    main(["run", str(ROOT / "trees" / "ahead.xml"), "--config", str(config), "--look", "none", "--log", str(log)])
    assert main(["replay", str(log)]) == 0
    assert "identical: 2" in capsys.readouterr().out
