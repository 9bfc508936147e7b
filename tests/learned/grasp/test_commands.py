"""`cell lab train|eval grasp`: files in, files out, and mistakes named before anything is trained."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from bracket_cell.commands.main import main
from bracket_lab.learned.grasp.data import read_scenes, write_scenes
from bracket_lab.learned.grasp.scenes import draw_scenes
from tests.learned.grasp.layouts import PRODUCT


def run(monkeypatch: pytest.MonkeyPatch, *words: str) -> int:
    monkeypatch.setattr("sys.argv", ["cell", *words])
    return main()


def test_a_planner_is_scored(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(monkeypatch, "lab", "eval", "grasp", "--kind", "rule", "--scenes", "12", "--json") == 0
    scores = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert 0.0 < scores["object_accuracy_1"] <= 1.0
    assert "needless_moves_6" in scores


@pytest.mark.torch
def test_damaged_scenes_are_named_before_training(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    data = tmp_path / "scenes.jsonl"
    write_scenes(data, draw_scenes(PRODUCT, 0, 2, "train"), PRODUCT, "a test")
    data.write_text(data.read_text().replace('"confidence"', '"certainty"', 1))
    out = tmp_path / "grasp.onnx"
    assert run(monkeypatch, "lab", "train", "grasp", "--data", str(data), "--out", str(out)) == 2
    assert "scenes.jsonl:2: detections.0.confidence" in capsys.readouterr().err.replace("\n", "")
    assert not out.exists()


@pytest.mark.long
@pytest.mark.torch
def test_scenes_from_a_file_train_a_planner(tmp_path: Path) -> None:
    from bracket_cell.learned.grasp.settings import PairwiseSettings
    from bracket_cell.learned.inference.onnx_model import OnnxModel
    from bracket_lab.learned.grasp.train import train_grasp

    data = tmp_path / "scenes.jsonl"
    write_scenes(data, draw_scenes(PRODUCT, 8, 30, "train"), PRODUCT, "a test")
    settings = PairwiseSettings(epochs=8, hidden=12, members=1, batch=32)
    scores = train_grasp(
        PRODUCT,
        tmp_path / "grasp.onnx",
        0,
        "pairwise",
        settings=settings,
        scenes=read_scenes(data, PRODUCT),
        quiet=True,
    )
    card = OnnxModel.load(tmp_path / "grasp.onnx", "grasp.pairwise").card
    assert card.config["split"] == "24 given scenes; scores on 6 others of them, of other runs"
    assert card.scores == scores
