"""`cell lab data stacks` and what `cell lab eval stacks` refuses."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from bracket_cell.commands.main import main
from bracket_lab.commands import stacks
from bracket_lab.experiments.stacks.vmrd import read_vmrd
from bracket_lab.stacks.draw import DrawnStack
from bracket_sim.stacks.settings import StackSettings
from tests.learned.stacks.folders import vmrd
from tests.learned.stacks.made_up import scene


def _drawn(number: int, settings: StackSettings, seed: int) -> DrawnStack:
    """A made-up scene whose picture is as bright as it has kinds to draw from."""
    assert seed == 4
    image = np.full((360, 480, 3), 8 * settings.kinds, np.uint8)
    return DrawnStack(scene(number), image)


def test_a_folder_of_vmrd_is_written_and_can_be_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(stacks, "draw_stack", _drawn)
    words = ["lab", "data", "stacks", "--out", str(tmp_path / "new"), "--scenes", "40", "--seed", "4"]
    assert main([*words, "--classes", "5,31", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    read = read_vmrd(tmp_path / "new")
    assert (told["scenes"], told["test"]) == (40, len(read.test)) == (40, 4)
    assert len(read.trainval) == 36
    assert {int(stacked_scene.name) % 2 for stacked_scene in read.test} == {0, 1}, "tests of each number of classes"
    assert read.test[0] == scene(int(read.test[0].name))
    assert "--classes 5,31" in told["made_by"]
    assert sorted(path.name for path in (tmp_path / "new").iterdir()) == [
        "Annotations",
        "Grasps",
        "ImageSets",
        "JPEGImages",
        "manifest.json",
    ]


@pytest.mark.parametrize("classes", ["3", "five", "5,40", ","])
def test_numbers_of_classes_must_be_legal(classes: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["lab", "data", "stacks", "--out", str(tmp_path / "new"), "--classes", classes]) == 2
    assert "must be numbers from 5 to 31" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()


def test_a_planner_that_nobody_knows_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["lab", "eval", "stacks", "--data", str(vmrd(tmp_path)), "--kind", "oracle"]) == 2
    assert "legal: default, paper, vmrn, gvmrn_rf, topmost, always" in capsys.readouterr().err


def test_faults_of_a_folder_are_told_without_a_traceback(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    annotation = vmrd(tmp_path) / "Annotations/00001.xml"
    annotation.write_text(
        annotation.read_text("utf-8").replace("<num>7</num></children>", "<num>8</num></children>", 1)
    )
    assert main(["lab", "eval", "stacks", "--data", str(tmp_path)]) == 2
    told = capsys.readouterr().err
    assert "00001.xml:8: object 1 has child 8, which is not there" in told
    assert "Traceback" not in told


@pytest.mark.torch
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_figure18_has_a_row_for_each_number_of_classes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from bracket_lab.experiments.stacks import experiment
    from tests.learned.stacks.test_experiment import NoFeatures

    monkeypatch.setattr(stacks, "draw_stack", _drawn)
    monkeypatch.setattr(experiment, "_regions", lambda _: NoFeatures())
    monkeypatch.chdir(tmp_path)
    words = ["--classes", "30,31", "--json"]
    assert main(["lab", "data", "stacks", "--out", "new", "--scenes", "40", "--seed", "4", *words]) == 0
    words += ["--kind", "always", "--detector-of", "new"]
    assert main(["lab", "eval", "stacks", "--data", "new", *words]) == 0
    rows = json.loads(capsys.readouterr().out.splitlines()[-1])["rows"]
    assert [(row["boxes"], row["classes"]) for row in rows] == [("true", 30), ("true", 31)]
