"""Training: repeatable, better than guessing, and the same in ONNX as in torch; no MuJoCo in this process."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from cell.interfaces.errors import InputError
from learned.grasp.graph import Attention, scene_graph
from learned.grasp.language import FIRST_LETTER, MAX_WORDS, encode
from learned.grasp.pairs import PAIR_FEATURES
from learned.grasp.planner import load_grasp_planner
from learned.grasp.scenes import Scene, data_hash, draw_scenes
from learned.grasp.training_settings import PairwiseSettings, PaperSettings, TrainingSettings
from learned.onnx_model import OnnxModel
from tests.learned.grasp.layouts import PRODUCT, walled

pytestmark = pytest.mark.torch  # torch is imported in the tests alone: other processes collect this file, too
TOLERANCE = 1e-5
SHORT_PAIRWISE = PairwiseSettings(
    random_share=0.0, scenes=80, test_scenes=40, epochs=60, batch=64, hidden=24, members=2
)
SHORT_PAPER = PaperSettings(scenes=20, test_scenes=8, epochs=2, batch=32, hidden=16, layers=2, edges="printed")
SEED = 5


@pytest.fixture(scope="module")
def scenes() -> list[Scene]:
    return list(draw_scenes(PRODUCT, 3, 20, "train"))


@dataclass(frozen=True)
class Trained:
    path: Path
    scores: dict[str, float]
    model: OnnxModel


@pytest.fixture(scope="module")
def pairwise(tmp_path_factory: pytest.TempPathFactory) -> Trained:
    from learned.grasp.train import train_grasp

    path = tmp_path_factory.mktemp("pairwise") / "grasp.onnx"
    scores = train_grasp(PRODUCT, path, SEED, "pairwise", settings=SHORT_PAIRWISE, quiet=True)
    return Trained(path, scores, OnnxModel.load(path, "grasp.pairwise"))


@pytest.fixture(scope="module")
def paper(tmp_path_factory: pytest.TempPathFactory) -> Trained:
    from learned.grasp.train import train_grasp

    path = tmp_path_factory.mktemp("paper") / "grasp.onnx"
    scores = train_grasp(PRODUCT, path, SEED, "paper", settings=SHORT_PAPER, quiet=True)
    return Trained(path, scores, OnnxModel.load(path, "grasp.paper"))


def drawn_for(settings: TrainingSettings) -> list[Scene]:
    return list(draw_scenes(PRODUCT, SEED, settings.scenes, "train", settings.data, settings.parts))


def test_training_again_gives_the_same_network_and_onnx_equals_torch(pairwise: Trained) -> None:
    import torch

    from learned.grasp.train import train_network

    net = train_network(drawn_for(SHORT_PAIRWISE), PRODUCT, SEED, SHORT_PAIRWISE)
    for count in (1, 7):
        pairs = np.random.default_rng(count).normal(size=(count, PAIR_FEATURES)).astype(np.float32)
        with torch.no_grad():
            expected = net(torch.from_numpy(pairs)).numpy()
        assert np.abs(pairwise.model.run({"pairs": pairs})["logits"] - expected).max() < TOLERANCE


def test_the_papers_network_is_the_same_in_onnx(paper: Trained, scenes: list[Scene]) -> None:
    import torch

    from learned.grasp.train import train_network

    net = train_network(drawn_for(SHORT_PAPER), PRODUCT, SEED, SHORT_PAPER)
    for scene in scenes:
        graphs = [scene_graph(scene.parts, i, PRODUCT, SHORT_PAPER.edges) for i in range(len(scene.parts))]
        inputs = {
            name: np.stack([getattr(graph, name) for graph in graphs]) for name in ("nodes", "weights", "present")
        }
        with torch.no_grad():
            verdict, words = net(*(torch.from_numpy(value) for value in inputs.values()))
        answer = paper.model.run(inputs)
        assert np.abs(answer["verdict"] - verdict.numpy()).max() < TOLERANCE
        assert answer["words"].tolist() == words.tolist()


@pytest.mark.parametrize("attention", ["additive", "printed", "none"])
def test_padding_does_not_change_the_answer(scenes: list[Scene], attention: Attention) -> None:
    import torch

    from learned.grasp.paper import PaperNet, graph_data

    torch.manual_seed(0)
    data = graph_data(scenes, PRODUCT, "normalised")
    net = PaperNet(data.nodes.shape[-1], 16, 2, attention=attention, types=len(PRODUCT.parts)).eval()
    small = int(data.present.sum(1).argmin())
    count = int(data.present[small].sum())
    graph = data.nodes[small : small + 1], data.weights[small : small + 1], data.present[small : small + 1]
    cut = graph[0][:, :count], graph[1][:, :count, :count], graph[2][:, :count]
    with torch.no_grad():
        assert torch.allclose(net.encode(*graph)[1], net.encode(*cut)[1], atol=1e-6)
        words = data.words[small : small + 1]
        (whole, said), (narrow, said_too) = (net.scores(*inputs, words) for inputs in (graph, cut))
        assert torch.allclose(whole[:, : narrow.shape[1]], narrow, atol=1e-6)
        assert torch.allclose(said, said_too, atol=1e-5)


def test_as_printed_every_node_has_its_graspability(scenes: list[Scene]) -> None:
    import torch

    from learned.grasp.paper import PaperNet, graph_data

    data = graph_data(scenes, PRODUCT, "normalised")
    net = PaperNet(data.nodes.shape[-1], 16, 2, attention="printed", types=len(PRODUCT.parts))
    optimiser = torch.optim.AdamW(net.parameters(), 0.01)
    chosen = torch.arange(len(data))
    before = data.loss(net, chosen).item()
    for _ in range(60):
        optimiser.zero_grad()
        data.loss(net, chosen).backward()  # type: ignore[no-untyped-call]
        optimiser.step()
    assert data.loss(net, chosen).item() < before / 2
    verdicts, _ = net.scores(data.nodes, data.weights, data.present, data.words)
    assert verdicts.shape == data.graspable.shape
    assert [scenes[0].graspable(index) for index in range(len(scenes[0].parts))] == [
        bool(data.graspable[required, 0]) for required in range(len(scenes[0].parts))
    ]


def test_untrained_decoder_speaks_in_sentences(scenes: list[Scene]) -> None:
    import torch

    from learned.grasp.paper import PaperNet, graph_data

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
    from learned.grasp.paper import graph_data

    data = graph_data(scenes[:1], PRODUCT, "normalised")
    graph = scene_graph(scenes[0].parts, 0, PRODUCT, "normalised")
    assert data.words.shape == (len(scenes[0].parts), MAX_WORDS)
    assert data.words[0].tolist() == encode(scenes[0].solution(0), graph.order)


def test_little_training_beats_guessing(pairwise: Trained) -> None:
    assert pairwise.scores["graspability_accuracy"] > 0.7
    plan = load_grasp_planner("pairwise", pairwise.path, PRODUCT).plan(walled("o3", "o3"), 0)
    assert plan.graspable < 0.5


def test_the_card_says_what_the_weights_are(pairwise: Trained, paper: Trained) -> None:
    for trained, settings in ((pairwise, SHORT_PAIRWISE), (paper, SHORT_PAPER)):
        card = trained.model.card
        assert card.scores == trained.scores
        assert card.seed == SEED
        assert card.data_sha256 == data_hash(drawn_for(settings))
        assert card.config["scenes"] == settings.scenes


def test_what_cannot_be_trained_is_refused(tmp_path: Path) -> None:
    from learned.grasp.train import train_grasp

    with pytest.raises(InputError, match="pairwise, paper"):
        train_grasp(PRODUCT, tmp_path / "rule.onnx", 0, "rule")


@pytest.mark.filterwarnings("ignore::FutureWarning", "ignore::DeprecationWarning")
def test_a_layer_is_the_weighted_convolution_of_a_library() -> None:
    """Eq. 5 against GraphConv of PyTorch Geometric, which sends along lists of edges."""
    import torch
    from torch_geometric.nn import GraphConv

    from learned.grasp.paper import GraphConvolution

    torch.manual_seed(2)
    ours, theirs = GraphConvolution(4, 5), GraphConv(4, 5)
    theirs.lin_root.weight, theirs.lin_rel.weight = ours.own.weight, ours.neighbours.weight
    theirs.lin_rel.bias = ours.own.bias
    nodes, weights = torch.rand(7, 4), torch.rand(7, 7) * (torch.rand(7, 7) < 0.5)
    receivers, senders = weights.nonzero(as_tuple=True)
    with torch.no_grad():
        expected = theirs(nodes, torch.stack([senders, receivers]), weights[receivers, senders])
        assert torch.allclose(ours(nodes[None], weights[None])[0], expected, atol=1e-6)
