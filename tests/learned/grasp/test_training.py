"""Training: repeatable, better than guessing, and the same in ONNX as in torch; no MuJoCo in this process."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from rich.console import Console

from cell.interfaces.errors import InputError
from learned.grasp.graph import scene_graph
from learned.grasp.language import FIRST_LETTER, MAX_WORDS, encode
from learned.grasp.pairs import PAIR_FEATURES
from learned.grasp.paper import PaperNet, graph_data
from learned.grasp.planner import load_grasp_planner
from learned.grasp.scenes import Scene, draw_scenes
from learned.grasp.train import (
    PairwiseSettings,
    PaperSettings,
    export_pairwise,
    export_paper,
    train_grasp,
    train_pairwise,
    train_paper,
)
from learned.onnx_model import ModelCard, OnnxModel, save_onnx
from tests.learned.grasp.layouts import PRODUCT

TOLERANCE = 1e-5
QUIET = Console(quiet=True)
SHORT_PAIRWISE = PairwiseSettings(scenes=60, test_scenes=40, epochs=15, batch=64, hidden=24, members=2)
SHORT_PAPER = PaperSettings(scenes=20, test_scenes=8, epochs=2, batch=32, hidden=16, layers=2)
CARD = ModelCard(kind="test", vocabulary={}, data_sha256="", command="", seed=0)


@pytest.fixture(scope="module")
def scenes() -> list[Scene]:
    return list(draw_scenes(PRODUCT, 3, 20, "train"))


def reloaded(path: Path, model: object) -> OnnxModel:
    save_onnx(model, path, CARD)  # type: ignore[arg-type]
    return OnnxModel.load(path, "test")


def test_pairwise_onnx_equals_torch(tmp_path: Path, scenes: list[Scene]) -> None:
    net = train_pairwise(scenes, PRODUCT, 0, SHORT_PAIRWISE, QUIET)
    model = reloaded(tmp_path / "pairs.onnx", export_pairwise(net))
    for count in (1, 7):
        pairs = np.random.default_rng(count).normal(size=(count, PAIR_FEATURES)).astype(np.float32)
        with torch.no_grad():
            expected = net(torch.from_numpy(pairs)).numpy()
        assert np.abs(model.run({"pairs": pairs})["logits"] - expected).max() < TOLERANCE


def test_paper_onnx_equals_torch(tmp_path: Path, scenes: list[Scene]) -> None:
    net = train_paper(scenes, PRODUCT, 0, SHORT_PAPER, QUIET)
    model = reloaded(tmp_path / "paper.onnx", export_paper(net))
    for scene in scenes:
        graph = scene_graph(scene.parts, 0, PRODUCT, "normalised")
        inputs = {"nodes": graph.nodes[None], "weights": graph.weights[None], "present": graph.present[None]}
        with torch.no_grad():
            verdict, words = net(*(torch.from_numpy(value) for value in inputs.values()))
        answer = model.run(inputs)
        assert abs(answer["verdict"][0] - float(verdict[0])) < TOLERANCE
        assert answer["words"].tolist() == words.tolist()


def test_padding_does_not_change_the_answer(scenes: list[Scene]) -> None:
    torch.manual_seed(0)
    data = graph_data(scenes, PRODUCT, "normalised")
    net = PaperNet(data.nodes.shape[-1], 16, 2).eval()
    small = int(data.present.sum(1).argmin())
    count = int(data.present[small].sum())
    graph = data.nodes[small : small + 1], data.weights[small : small + 1], data.present[small : small + 1]
    cut = graph[0][:, :count], graph[1][:, :count, :count], graph[2][:, :count]
    with torch.no_grad():
        assert torch.allclose(net.encode(*graph)[1], net.encode(*cut)[1], atol=1e-6)


def test_untrained_decoder_speaks_in_sentences(scenes: list[Scene]) -> None:
    torch.manual_seed(1)
    data = graph_data(scenes, PRODUCT, "printed")
    net = PaperNet(data.nodes.shape[-1], 16, 2).eval()
    with torch.no_grad():
        _, words = net(data.nodes, data.weights, data.present)
    for sentence, present in zip(words.tolist(), data.present, strict=True):
        letters = [word - FIRST_LETTER for word in sentence if word >= FIRST_LETTER]
        assert len(letters) == len(set(letters))
        assert all(1 <= node < int(present.sum()) for node in letters)


def test_words_of_the_data_are_the_solutions(scenes: list[Scene]) -> None:
    data = graph_data(scenes[:1], PRODUCT, "normalised")
    graph = scene_graph(scenes[0].parts, 0, PRODUCT, "normalised")
    assert data.words.shape == (len(scenes[0].parts), MAX_WORDS)
    assert data.words[0].tolist() == encode(scenes[0].solution(0), graph.order)


def test_training_writes_weights_that_plan_and_is_repeatable(tmp_path: Path) -> None:
    paths = [tmp_path / name for name in ("first.onnx", "second.onnx")]
    scores = [train_grasp(PRODUCT, path, 5, "pairwise", settings=SHORT_PAIRWISE, quiet=True) for path in paths]
    assert scores[0] == scores[1]
    assert scores[0]["object_accuracy_1"] > 0.75
    card = OnnxModel.load(paths[0], "grasp.pairwise").card
    assert card.scores == scores[0]
    assert card.seed == 5
    assert len(card.data_sha256) == 64
    parts = next(draw_scenes(PRODUCT, 1, 1, "test")).parts
    first, second = (load_grasp_planner("pairwise", path, PRODUCT).plan(parts, 0) for path in paths)
    assert first == second


def test_paper_training_writes_weights_that_plan(tmp_path: Path) -> None:
    path = tmp_path / "paper.onnx"
    settings = SHORT_PAPER.model_copy(update={"edges": "printed"})
    scores = train_grasp(PRODUCT, path, 5, "paper", settings=settings, quiet=True)
    assert 0.0 <= scores["object_accuracy_3"] <= 1.0
    assert OnnxModel.load(path, "grasp.paper").card.config["edges"] == "printed"


def test_what_cannot_be_trained_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="pairwise, paper"):
        train_grasp(PRODUCT, tmp_path / "rule.onnx", 0, "rule")
