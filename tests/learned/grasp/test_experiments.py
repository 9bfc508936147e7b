"""Experiments on grasp planners: every one of the tables can be trained and asked, and has its row on the page."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from learned.grasp.scenes import draw_scenes
from learned.grasp.settings import DetectionNoise, SceneSettings
from tests.learned.grasp.layouts import PRODUCT

pytestmark = pytest.mark.torch


def test_every_baseline_learns_and_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    from learned.grasp.experiments.baselines import BASELINES, planner_of

    for name, baseline in BASELINES.items():
        if baseline.settings is not None:
            short = baseline.settings.model_copy(update={"epochs": 1})
            monkeypatch.setitem(BASELINES, name, replace(baseline, settings=short))
    (scene,) = draw_scenes(PRODUCT, 31, 1, "validation", SceneSettings(crops=True))
    for name in BASELINES:
        planner = planner_of(name, PRODUCT, 4, 0, DetectionNoise())
        for required in range(len(scene.parts)):
            plan = planner.plan(scene.parts, required)
            assert 0.0 <= plan.graspable <= 1.0
            assert required not in plan.blockers


def test_a_cell_is_scored(monkeypatch: pytest.MonkeyPatch) -> None:
    from learned.grasp.experiments import cells

    monkeypatch.setattr(cells, "_test_scenes", lambda *_: tuple(draw_scenes(PRODUCT, 32, 5, "test")))
    rules = [cell for cell in cells.table2_cells(PRODUCT) if cell.key["planner"] == "rule"]
    assert len({cell.name for cell in rules}) == len(rules) == 3
    assert 0.0 < rules[0].measure()["object_accuracy_1"] <= 1.0


def test_the_page_has_a_row_for_every_planner(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from learned.experiments import Store, write_page
    from learned.grasp.experiments.baselines import BASELINES
    from learned.grasp.experiments.page import EXPERIMENTS, HEAD

    names = [f"object_accuracy_{count}" for count in (1, 2, 3)] + ["iterative_success", "steps", "needless_moves"]
    names += ["object_accuracy_by_type", "graspability_accuracy"]
    values = {name + end: value for name in names for end, value in (("", 0.5), ("_low", 0.4), ("_high", 0.6))}
    monkeypatch.setattr(Store, "run", lambda _self, _title, cells: [(cell.key, values) for cell in cells])
    out = tmp_path / "grasp.md"
    write_page(HEAD, EXPERIMENTS, PRODUCT, Store(tmp_path / "none"), out, {"command": "a test"})
    text = out.read_text()
    for baseline in BASELINES.values():
        assert f"| {baseline.title} | .500 (.400 - .600)" in text
    assert text.count("\n## ") == sum(len(experiment.sections) for experiment in EXPERIMENTS.values())
    for picture in ("grasp_noise.png", "grasp_curve.png"):
        assert picture in text
        assert (tmp_path / picture).stat().st_size > 5000
