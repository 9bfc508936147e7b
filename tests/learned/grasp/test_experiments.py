"""Experiments on grasp planners: every one of the tables can be trained and asked, and has its row on the page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bracket_cell.learned.grasp.crops import CHANNELS, CROP_PX, Crops, View
from bracket_cell.learned.grasp.settings import PAPER_SCENES, DetectionNoise
from bracket_lab.learned.grasp.scenes import draw_scenes
from tests.learned.grasp.layouts import PRODUCT

pytestmark = pytest.mark.torch


def no_camera(views: Sequence[View]) -> list[Crops]:
    return [np.zeros((len(parts), CHANNELS, CROP_PX, CROP_PX), np.uint8) for _, parts in views]


def test_every_baseline_learns_and_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    from bracket_lab.experiments.paper.grasp import BASELINES, trained_baseline

    for name, baseline in BASELINES.items():
        if baseline.settings is not None:
            short = baseline.settings.model_copy(update={"epochs": 1, "footprint_passes": 10})
            monkeypatch.setitem(BASELINES, name, replace(baseline, settings=short))
    drawn = list(draw_scenes(PRODUCT, 31, 1, "validation"))
    for name in BASELINES:
        asked = trained_baseline(name, PRODUCT, no_camera, 4, 0, DetectionNoise(), PAPER_SCENES)
        (scene,) = asked.look(drawn)
        for required in range(len(scene.parts)):
            plan = asked.planner.plan(scene.parts, required)
            assert 0.0 <= plan.graspable <= 1.0
            assert required not in plan.blockers


def test_a_cell_is_scored(monkeypatch: pytest.MonkeyPatch) -> None:
    from bracket_lab.experiments import grasp_cells as cells

    monkeypatch.setattr(cells, "TEST_SCENES", 5)
    monkeypatch.setattr(cells, "FEW_SCENES", 2)
    rules = [cell for cell in cells.table2_cells(PRODUCT, no_camera) if cell.key["planner"] == "rule"]
    assert len({cell.name for cell in rules}) == len(rules) == 3
    assert 0.0 < rules[0].measure()["object_accuracy_1"] <= 1.0


def test_another_seed_gives_other_test_scenes(monkeypatch: pytest.MonkeyPatch) -> None:
    from bracket_lab.experiments import grasp_cells as cells
    from bracket_lab.experiments.grasp_page import experiments

    asked: list[tuple[int, str]] = []

    def drawn(_product: object, seed: int, _count: int, split: str, *_: object) -> list[object]:
        asked.append((seed, split))
        return []

    monkeypatch.setattr(cells, "draw_scenes", drawn)
    monkeypatch.setattr(cells, "evaluate_scenes", lambda _planner, _scenes, seed: {"seed": seed})
    names = set()
    for seed in (7, 8):
        table = experiments(no_camera, seed)["table2"].cells(PRODUCT)
        rule = next(cell for cell in table if cell.key["planner"] == "rule")
        names.add(rule.name)
        assert rule.measure() == {"seed": seed}
    assert asked == [(7, "test"), (8, "test")]
    assert len(names) == 2  # what is kept of one seed is not taken for the other's


def test_the_page_has_a_row_for_every_planner(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from bracket_lab.experiments.experiments import kept, write_page
    from bracket_lab.experiments.grasp_page import HEAD, experiments
    from bracket_lab.experiments.paper.grasp import BASELINES

    names = [f"{score}_{count}" for score in ("object_accuracy", "by_type") for count in (1, 2, 3)]
    names += ["iterative_success", "steps", "needless_moves", "graspability_accuracy"]
    values = {name + end: value for name in names for end, value in (("", 0.5), ("_low", 0.4), ("_high", 0.6))}
    monkeypatch.setattr(
        "bracket_lab.experiments.experiments.measured", lambda _, cells, *__: [(one.key, values) for one in cells]
    )
    out, tables = tmp_path / "grasp.md", experiments(no_camera)
    write_page(HEAD, tables, PRODUCT, kept(tmp_path / "none"), out, {"command": "a test"})
    text = out.read_text()
    for baseline in BASELINES.values():
        assert f"| {baseline.title} | .500 (.400 - .600)" in text
    assert text.count("\n## ") == sum(len(experiment.sections) for experiment in tables.values())
