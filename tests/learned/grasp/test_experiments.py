"""Experiments: every planner of the tables can be trained and asked, cells are kept, reports hold all rows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from learned.grasp.scenes import draw_scenes
from learned.grasp.settings import DetectionNoise, SceneSettings
from learned.grasp.tally import Tally, half_width
from tests.learned.grasp.layouts import PRODUCT

QUIET = Console(quiet=True)


def test_intervals_hold_the_share_and_shrink() -> None:
    assert half_width(0.5, 1000) == pytest.approx(0.031, abs=0.001)
    assert half_width(1.0, 50) > 0.03
    tally = Tally()
    for right in (True, False, True, True):
        tally.add("a", right)
        tally.measure("b", 3.0 * right)
    scores = tally.scores()
    assert (scores["a"], scores["b"]) == (0.75, 2.25)


@pytest.mark.torch
def test_every_contender_learns_and_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    from learned.grasp import contenders
    from learned.grasp.contenders import CONTENDERS, Contender, Trainer

    for name, contender in CONTENDERS.items():
        if contender.settings is not None:
            short = contender.settings.model_copy(update={"epochs": 1})
            monkeypatch.setitem(contenders.CONTENDERS, name, Contender(contender.title, short))
    trainer = Trainer(PRODUCT)
    (scene,) = draw_scenes(PRODUCT, 31, 1, "validation", SceneSettings(crops=True))
    for name in CONTENDERS:
        planner = trainer.planner(name, 4, 0)(DetectionNoise())
        for required in range(len(scene.parts)):
            plan = planner.plan(scene.parts, required)
            assert 0.0 <= plan.graspable <= 1.0
            assert required not in plan.blockers


@pytest.mark.torch
def test_cells_are_computed_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from learned.grasp import experiments
    from learned.grasp.experiments import Cell, run_cells

    monkeypatch.setattr(experiments, "_test_scenes", lambda *_: tuple(draw_scenes(PRODUCT, 32, 5, "test")))
    cells = [Cell("rule"), Cell("rule", what="fifty")]
    first = run_cells(cells, PRODUCT, tmp_path, QUIET)
    assert len(list(tmp_path.glob("*.json"))) == 2
    monkeypatch.setattr(experiments, "_scores", None)
    assert run_cells(cells, PRODUCT, tmp_path, QUIET) == first


@pytest.mark.torch
def test_a_report_has_a_row_for_every_planner(tmp_path: Path) -> None:
    from learned.grasp.contenders import CONTENDERS
    from learned.grasp.experiments import EXPERIMENTS, cells_of
    from learned.grasp.report import write_report

    names = ("object_accuracy_1", "object_accuracy_2", "object_accuracy_3", "iterative_success", "steps")
    scores = {
        cell: dict.fromkeys((*names, "needless_moves", "object_accuracy_1_ci95"), 0.5)
        for name in EXPERIMENTS
        for cell in cells_of(name)
    }
    out = tmp_path / "grasp.md"
    write_report(out, EXPERIMENTS, scores, {"command": "a test"})
    text = out.read_text()
    for contender in CONTENDERS.values():
        assert f"| {contender.title} | .500" in text
    assert text.count("\n## ") == len(EXPERIMENTS)
    for picture in ("grasp_noise.png", "grasp_curve.png"):
        assert picture in text
        assert (tmp_path / picture).stat().st_size > 5000


@pytest.mark.torch
def test_a_fit_that_was_interrupted_ends_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import torch

    from learned.grasp import fitting
    from learned.grasp.train import train_pairwise
    from learned.grasp.training_settings import PairwiseSettings

    settings = PairwiseSettings(scenes=6, observations=1, epochs=4, batch=8, hidden=8, members=1)
    scenes = list(draw_scenes(PRODUCT, 33, 6, "train"))
    whole = train_pairwise(scenes, PRODUCT, 0, settings, QUIET)
    monkeypatch.setattr(fitting, "_SAVED_EVERY", 2)
    checkpoint = tmp_path / "state.pt"

    def interrupted(*state: Any) -> None:
        save(*state)
        raise KeyboardInterrupt

    save = fitting._save
    monkeypatch.setattr(fitting, "_save", interrupted)
    with pytest.raises(KeyboardInterrupt):
        train_pairwise(scenes, PRODUCT, 0, settings, QUIET, checkpoint)
    monkeypatch.setattr(fitting, "_save", save)
    resumed = train_pairwise(scenes, PRODUCT, 0, settings, QUIET, checkpoint)
    for before, after in zip(whole.parameters(), resumed.parameters(), strict=True):
        assert torch.equal(before, after)
