"""Both algorithm trees against the simulated cell, from camera pixels to friction grasps."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

from cell.configuration import ROOT
from tests.benchmarks.robot_alone import scene_and_requirement
from tests.integration.cell_rig import ASSEMBLE, COMMISSION, lifted, robot_alone, run_tree, with_person


@pytest.mark.parametrize(("goal", "seed"), [("g1", 2), ("g2", 3)])
def test_a_bracket_is_assembled_together(goal: str, seed: int) -> None:
    with with_person(goal, seed) as cell:
        outcome, diary = run_tree(cell, ASSEMBLE)
        report = cell.score.report()
    assert outcome.end == "finished", outcome.reason
    assert report["correct"]
    assert report["wrong_placements"] == 0
    assert isinstance(report["robot_placements"], int)
    assert report["robot_placements"] >= 1
    assert [fields["goal"] for _, topic, fields in diary.notes if topic == "belief" and "goal" in fields][-1] == goal
    refused = [fields["subject"] for _, _, fields in diary.notes if fields.get("decision") == "refused"]
    assert "assembly plan" not in refused


def test_the_same_seed_decides_the_same_in_two_processes() -> None:
    runs = [
        subprocess.Popen(
            [sys.executable, "-m", "tests.integration.digest", "g0", "1"],
            cwd=ROOT,
            env={**os.environ, "PYTHONHASHSEED": hash_seed},
            stdout=subprocess.PIPE,
            text=True,
        )
        for hash_seed in ("1", "2")
    ]
    first, second = (json.loads(run.communicate(timeout=300)[0]) for run in runs)
    assert first == second
    assert first["correct"]
    assert first["ticks"] > 500


def test_a_blocked_part_is_fetched_out_of_clutter() -> None:
    scene, part = scene_and_requirement(count=4, seed=1005)
    with robot_alone(scene, seed=1005) as cell:
        outcome, diary = run_tree(cell, COMMISSION, "FetchPart", {"part": part})
        held = lifted(cell, part)
    assert outcome.end == "finished", outcome.reason
    assert held
    solutions = [str(fields["solution"]) for _, _, fields in diary.notes if "solution" in fields]
    assert any(solution.startswith("move") for solution in solutions), "the scene must need a move first"
