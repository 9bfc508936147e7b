"""A bracket is assembled around a post that stands between tray and bracket, from camera pixels."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from bracket_cell.commands.main import main
from tests.cell.interfaces.test_obstacles import bench_with

POST = "{name: the camera post, position_m: [0.62, -0.10, 0.25], box_m: [0.06, 0.06, 0.50]}"


@pytest.mark.slow
def test_a_bracket_is_assembled_around_a_post(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, log = bench_with(tmp_path, POST), tmp_path / "log.mcap"
    assert main(["run", "--config", str(path), "--goal", "g0", "--seed", "5", "--log", str(log), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["correct"]
    assert answer["contacts"] == 0
    assert answer["robot_placements"] >= 1
