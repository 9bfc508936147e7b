"""The whole experiment on made-up features: its cells and scores."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from bracket_cell.commands.main import main
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.stacks import VMRD_CLASSES, StackedScene
from bracket_lab.commands import stacks as commands
from bracket_lab.experiments.experiments import kept, measured
from bracket_lab.experiments.stacks import experiment
from bracket_lab.experiments.stacks.checks import StackTraining
from bracket_lab.experiments.stacks.experiment import Study
from bracket_lab.experiments.stacks.vmrd import read_vmrd, write_scene, write_splits
from bracket_lab.learned.training.schedule import Schedule
from tests.learned.stacks.folders import picture
from tests.learned.stacks.made_up import scene
from tests.learned.stacks.test_formats import by_another_program

WIDTH = 6
pytestmark = [pytest.mark.slow, pytest.mark.torch, pytest.mark.filterwarnings("ignore::DeprecationWarning")]
BRIEF = StackTraining(share=0.05, heads=Schedule(epochs=1))


class NoFeatures:
    """Stands for the regions of a detector that finds one box."""

    width = WIDTH

    def features(self, image: NDArray[np.uint8], boxes: Array) -> NDArray[np.float16]:  # noqa: ARG002
        return np.ones((len(boxes), WIDTH), np.float16)

    def found(self, image: NDArray[np.uint8]) -> tuple[Array, list[str], list[float]]:  # noqa: ARG002
        return np.array([[10.0, 10.0, 50.0, 50.0]]), ["box"], [0.9]


@pytest.fixture
def study(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Study:
    monkeypatch.setattr(experiment, "_regions", lambda _: NoFeatures())
    scenes = [scene(seed) for seed in range(60)]
    for stacked_scene in scenes:
        write_scene(tmp_path / "data", stacked_scene, picture())
    names = [stacked_scene.name for stacked_scene in scenes]
    write_splits(tmp_path / "data", names[:40], names[40:])
    return Study(read_vmrd(tmp_path / "data"), tmp_path / "kept", BRIEF, 0)


def test_tables_have_a_row_for_each_planner(study: Study, tmp_path: Path) -> None:
    cells = measured("stacks", study.cells([31]), kept(tmp_path / "cells.jsonl"), quiet=True)
    assert len(cells) == 6 + 5, "heights are of true boxes alone"
    by_planner = {(key["planner"], key["boxes"]): values for key, values in cells}
    assert by_planner["always", "detected"]["OR"] == 0.0
    assert by_planner["default", "true"]["pictures"] == 20


def test_figure18_compares_as_many_pictures_of_each_number(study: Study, tmp_path: Path) -> None:
    cells = measured("stacks", study.cells([25, 31], ["default", "paper"]), kept(tmp_path / "cells.jsonl"), quiet=True)
    counts = {key["classes"]: (values["pictures"], values["learned_from"]) for key, values in cells}
    assert counts[25] == counts[31]
    assert all({"graph", "decoder"} <= values.keys() for _, values in cells)


def test_figure18_takes_what_was_drawn_from_so_many_classes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(experiment, "_regions", lambda _: NoFeatures())
    for number in range(80):  # an eighth of all is drawn from 25 classes, though more show no others
        drawn_from = 25 if number % 8 == 0 else 31
        seeds = (seed for seed in range(number, 10_000, 80))
        some = next(stacked_scene for stacked_scene in map(scene, seeds) if _shows(stacked_scene, VMRD_CLASSES[:25]))
        write_scene(tmp_path, replace(some, name=f"{number}", drawn_from=drawn_from), picture())
    write_splits(tmp_path, map(str, range(40)), map(str, range(40, 80)))
    study = Study(read_vmrd(tmp_path), tmp_path / "kept", BRIEF, 0)
    cells = measured("stacks", study.cells([25, 31], ["always"]), kept(tmp_path / "cells.jsonl"), quiet=True)
    assert {values["learned_from"] for _, values in cells} <= set(range(6))


def test_a_folder_of_vmrd_gives_table_4_by_one_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The folder is another program's."""
    monkeypatch.setattr(experiment, "_regions", lambda _: NoFeatures())
    monkeypatch.setattr(commands, "KEPT", tmp_path / "kept")
    folder = by_another_program(tmp_path / "VMRD")
    words = ["--kind", "paper", "--kind", "vmrn", "--kind", "always", "--json"]
    assert main(["lab", "eval", "stacks", "--data", str(folder), "--share", "0.05", *words]) == 0
    printed = capsys.readouterr().out
    told = json.loads(printed.splitlines()[-1])
    assert "VMRN, true boxes, 31 classes" in printed
    rows = {(row["planner"], row["boxes"]) for row in told["rows"]}
    assert rows == {(kind, boxes) for kind in ("paper", "vmrn", "always") for boxes in ("true", "detected")}
    assert told["paper"]["paper"] == ".62"


def _shows(one: StackedScene, classes: Sequence[str]) -> bool:
    return {each.name for each in one.objects} <= set(classes)
