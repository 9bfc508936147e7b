"""`cell lab eval weights` gives a verdict for each network: the same, apart by chance, or apart."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from functools import partial
from pathlib import Path

import onnx
import pytest

from bracket_cell.commands.main import main
from bracket_cell.kinds import WEIGHTS
from bracket_cell.learned.inference.onnx_model import OnnxModel, save_onnx
from bracket_ground.files.files import shipped
from bracket_lab.evaluations import weights
from bracket_lab.evaluations.weights import APART, CHANCE, SAME, Figure, compared


def share(value: float, n: int) -> Mapping[str, Figure]:
    return {"right": {"value": value, "n": float(n)}}


@pytest.mark.parametrize(
    ("before", "now", "n", "verdict"),
    [(0.99, 0.987, 200, SAME), (0.99, 0.97, 200, CHANCE), (0.99, 0.97, 5000, APART), (0.98, 0.9, 200, APART)],
)
def test_the_verdict_goes_by_points_and_by_how_many(before: float, now: float, n: int, verdict: str) -> None:
    told = compared(share(before, n), share(now, n))
    assert told.verdict == verdict
    assert told.told["right"]["points"] == pytest.approx(100 * (now - before))
    assert f"of {n}" in told.rows["right"]


def test_the_worst_figure_decides_and_those_without_a_share_have_none() -> None:
    before = {"near": {"value": 0.9, "n": 100.0}, "far": {"value": 0.9, "n": 100.0}, "mm": {"value": 3.0}}
    now = {"near": {"value": 0.9, "n": 100.0}, "far": {"value": 0.5, "n": 100.0}, "mm": {"value": 9.0}}
    told = compared(before, now)
    assert told.verdict == APART
    assert told.told["near"]["verdict"] == SAME
    assert "verdict" not in told.told["mm"]
    assert told.rows["mm"] == "3 -> 9"


@pytest.mark.slow
def test_planners_are_scored_on_the_same_trays_and_orders_whatever_their_cards_tell(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(WEIGHTS, tmp_path / "again")
    file = tmp_path / "again" / "grasp_pairwise.onnx"
    card = OnnxModel.card_of(file)
    save_onnx(onnx.load(file), file, card.model_copy(update={"scores": dict.fromkeys(card.scores, 0.5)}))
    monkeypatch.setattr(weights, "Sample", partial(weights.Sample, scenes=20))
    assert (
        main(["lab", "eval", "weights", str(tmp_path / "again"), "--only", "grasp", "--only", "semantic", "--json"])
        == 0
    )
    networks = json.loads(capsys.readouterr().out)["networks"]
    assert sorted(networks) == ["grasp pairwise", "grasp paper", "semantic factored", "semantic paper"]
    for figures in networks.values():
        assert len(figures) >= 2
        assert all(figure["points"] == 0 and figure["verdict"] == SAME for figure in figures.values())
    assert networks["grasp pairwise"]["object_accuracy_1"]["n"] == 20


def test_what_was_measured_is_kept_and_both_folders_are_scored_on_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[tuple[Path, int]] = []

    def scored(sample: weights.Sample, file: Path, _: str) -> dict[str, float]:
        asked.append((file.parent, sample.first_seed))
        return {"right": 0.99 if file.parent == WEIGHTS else 0.9, "holes": 300.0}

    monkeypatch.setitem(weights._SCORED, "holes", scored)
    shutil.copy(WEIGHTS / "holes_plate.onnx", tmp_path)
    words = ["lab", "eval", "weights", str(tmp_path), "--only", "holes", "--seeds", "907000:907006", "--json"]
    assert main([*words, "--out", str(tmp_path / "rows.jsonl")]) == 0
    assert asked == [(WEIGHTS, 907000), (tmp_path, 907000)]
    told = json.loads(capsys.readouterr().out)["networks"]["holes plate"]["right"]
    assert told == {"before": 0.99, "now": 0.9, "points": -9.0, "n": 300, "chance_points": 3.65, "verdict": APART}
    assert main([*words, "--out", str(tmp_path / "rows.jsonl")]) == 0
    assert len(asked) == 2


def test_weights_of_another_product_are_told_before_anything_is_scored(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(weights, "_SCORED", {})
    for name in ("cell.yaml", "sim.yaml", "products.yaml"):
        (tmp_path / name).write_text(shipped("bracket_cell.config", name).read_text().replace("o3", "relief"))
    config = tmp_path / "cell.yaml"
    assert main(["lab", "eval", "weights", str(WEIGHTS), "--only", "holes", "--config", str(config)]) == 2
    told = " ".join(capsys.readouterr().err.split())
    assert "knows the parts o1, o2, o3, and this product has o1, o2, relief" in told
    assert "--against FOLDER" in told
