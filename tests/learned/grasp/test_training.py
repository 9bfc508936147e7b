"""Training: repeatable, better than guessing, and the same in ONNX as in torch; no MuJoCo in this process."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from bracket_cell.learned.grasp.boxes import boxes_of
from bracket_cell.learned.grasp.crops import CHANNELS, CROP_PX, EMBEDDING, Crops, View, load_crops
from bracket_cell.learned.grasp.pairs import PAIR_FEATURES
from bracket_cell.learned.grasp.settings import PairwiseSettings, PaperSettings, TrainingSettings
from bracket_cell.learned.inference.onnx_model import OnnxModel
from bracket_ground.errors import InputError
from bracket_ground.interfaces.planning import crops_file
from bracket_lab.learned.grasp.evaluate import embedded
from bracket_lab.learned.grasp.graph import scene_graph
from bracket_lab.learned.grasp.language import MAX_WORDS, decode, encode
from bracket_lab.learned.grasp.paper_planner import load_grasp_planner
from bracket_lab.learned.grasp.scenes import Scene, data_hash, draw_scenes
from tests.learned.grasp.layouts import PRODUCT, walled

if TYPE_CHECKING:
    from bracket_lab.learned.grasp.footprints import Maps

pytestmark = pytest.mark.torch  # torch is imported in the tests alone: other processes collect this file, too
TOLERANCE = 1e-5
SHORT_PAIRWISE = PairwiseSettings(
    random_share=0.0, scenes=60, test_scenes=30, epochs=40, batch=64, hidden=24, members=1
)
SHORT_PAPER = PaperSettings(
    scenes=12,
    test_scenes=4,
    epochs=1,
    batch=8,
    hidden=16,
    layers=2,
    loose_share=0.0,
    footprint_passes=20,
)
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
    from bracket_lab.learned.grasp.train import train_grasp

    path = tmp_path_factory.mktemp("pairwise") / "grasp.onnx"
    scores = train_grasp(PRODUCT, path, SEED, "pairwise", settings=SHORT_PAIRWISE, quiet=True)
    return Trained(path, scores, OnnxModel.load(path, "grasp.pairwise"))


@pytest.fixture(scope="module")
def paper(tmp_path_factory: pytest.TempPathFactory) -> Trained:
    from bracket_lab.learned.grasp.train import train_grasp

    path = tmp_path_factory.mktemp("paper") / "grasp.onnx"
    scores = train_grasp(PRODUCT, path, SEED, "paper", settings=SHORT_PAPER, camera=noisy_camera, quiet=True)
    return Trained(path, scores, OnnxModel.load(path, "grasp.paper"))


def noisy_camera(views: Sequence[View]) -> list[Crops]:
    """Crops that depend on the view alone; no OpenGL beside torch."""
    return [
        np.random.default_rng(int(1e6 * abs(boxes.centre_m.sum()))).integers(
            0, 256, (len(parts), CHANNELS, CROP_PX, CROP_PX), np.uint8
        )
        for boxes, parts in views
    ]


def order_of(scene: Scene) -> tuple[int, ...]:
    return scene_graph(scene.parts, (0,), PRODUCT).order


def random_maps(scenes: list[Scene]) -> list[Maps]:
    """Footprints that depend on the scene alone."""
    rng, shape = np.random.default_rng(SEED), (len(PRODUCT.parts), CROP_PX // 2, CROP_PX // 2)
    return [rng.integers(0, 256, (len(scene.parts), *shape), np.uint8) for scene in scenes]


def mirrored(maps: Maps) -> list[Maps]:
    return [np.ascontiguousarray(maps[:, :, ::rows, ::columns]) for rows in (1, -1) for columns in (1, -1)]


def drawn_for(settings: TrainingSettings) -> list[Scene]:
    return list(draw_scenes(PRODUCT, SEED, settings.scenes, "train", settings.data, settings.parts))


@pytest.mark.slow
def test_training_again_gives_the_same_network_and_onnx_equals_torch(pairwise: Trained) -> None:
    import torch

    from bracket_lab.learned.grasp.train import train_network

    net = train_network(drawn_for(SHORT_PAIRWISE), PRODUCT, SEED, SHORT_PAIRWISE)
    for count in (1, 7):
        pairs = np.random.default_rng(count).normal(size=(count, PAIR_FEATURES)).astype(np.float32)
        with torch.no_grad():
            expected = net(torch.from_numpy(pairs)).numpy()
        assert np.abs(pairwise.model.run({"pairs": pairs})["logits"] - expected).max() < TOLERANCE


@pytest.mark.long
def test_the_papers_network_is_the_same_in_onnx(paper: Trained, scenes: list[Scene]) -> None:
    import torch

    from bracket_lab.learned.grasp.train import train_network

    net = train_network(drawn_for(SHORT_PAPER), PRODUCT, SEED, SHORT_PAPER, camera=noisy_camera)
    crops = load_crops(crops_file(paper.path))
    for scene in embedded(scenes, noisy_camera, crops):
        graphs = [scene_graph(scene.parts, (i,), PRODUCT, crops=True) for i in range(len(scene.parts))]
        inputs = {
            name: np.stack([getattr(graph, name) for graph in graphs]) for name in ("nodes", "weights", "present")
        }
        (images,) = noisy_camera([(scene.boxes, scene.parts)])
        with torch.no_grad():
            verdict, words = net(*(torch.from_numpy(value) for value in inputs.values()))
            features = net.crops(torch.from_numpy(images)).numpy()  # type: ignore[operator]
        answer = paper.model.run(inputs)
        assert np.abs(answer["verdict"] - verdict.numpy()).max() < TOLERANCE
        assert answer["words"].tolist() == words.tolist()
        assert np.allclose([part.embedding for part in scene.parts], features, atol=1e-4)


@pytest.mark.slow
def test_an_interrupted_training_keeps_what_tells_footprints(
    tmp_path: Path, paper: Trained, monkeypatch: pytest.MonkeyPatch
) -> None:
    from bracket_lab.learned.grasp import footprints, train
    from bracket_lab.learned.training import recipe
    from bracket_lab.learned.training.training_loop import fit

    flipped_crops = footprints.flipped_crops
    learned: list[int] = []

    def stopped(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    def counted(crops: Any, dims: Any) -> Any:
        learned.append(len(crops))
        return flipped_crops(crops, dims)

    def again() -> None:
        train.train_grasp(PRODUCT, tmp_path / "grasp.onnx", SEED, "paper", settings=SHORT_PAPER, camera=noisy_camera)

    monkeypatch.setattr(footprints, "flipped_crops", counted)
    monkeypatch.setattr(recipe, "fit", stopped)
    with pytest.raises(KeyboardInterrupt):
        again()
    assert learned
    learned.clear()
    monkeypatch.setattr(recipe, "fit", fit)
    again()
    assert not learned
    assert not list(tmp_path.glob("*checkpoint*"))
    assert crops_file(tmp_path / "grasp.onnx").read_bytes() == crops_file(paper.path).read_bytes()


def test_padding_does_not_change_the_answer(scenes: list[Scene]) -> None:
    import torch

    from bracket_lab.learned.grasp.paper import PaperNet, graph_data

    torch.manual_seed(0)
    data = graph_data(scenes, PRODUCT)
    net = PaperNet(len(PRODUCT.parts), 16, 2, features=data.nodes.shape[-1]).eval()
    small = int(data.present.sum(1).argmin())
    count = int(data.present[small].sum())
    graph = data.nodes[small : small + 1], data.weights[small : small + 1], data.present[small : small + 1]
    cut = graph[0][:, :count], graph[1][:, :count, :count], graph[2][:, :count]
    with torch.no_grad():
        for whole, narrow in zip(net.encode(*graph), net.encode(*cut), strict=True):
            assert torch.allclose(whole[:, :count], narrow, atol=1e-6)
        assert net(*graph)[1].tolist() == net(*cut)[1].tolist()


def test_it_learns_verdicts_and_words_of_all_required_parts(scenes: list[Scene]) -> None:
    import torch

    from bracket_lab.learned.grasp.paper import PaperNet, graph_data

    torch.manual_seed(0)
    data = graph_data(scenes, PRODUCT, maps=random_maps(scenes))
    features = data.nodes.shape[-1] + EMBEDDING
    net = PaperNet(len(PRODUCT.parts), 16, 2, features=features, crops=True)
    optimiser = torch.optim.AdamW(net.parameters(), 0.01)
    chosen = torch.arange(len(data))
    before = data.loss(net, chosen).item()
    for _ in range(60):
        optimiser.zero_grad()
        data.loss(net, chosen).backward()  # type: ignore[no-untyped-call]
        optimiser.step()
    assert data.loss(net, chosen).item() < before / 2


def test_turning_the_scene_turns_poses_and_not_footprints(scenes: list[Scene]) -> None:
    """Distances and differences of headings stay; mirrored footprints are one of four flips of what was seen."""
    import torch

    from bracket_lab.learned.grasp.paper import PaperNet, graph_data

    maps = random_maps(scenes)
    data = graph_data(scenes, PRODUCT, maps=maps)
    net = PaperNet(len(PRODUCT.parts), 8, 1, features=data.nodes.shape[-1] + EMBEDDING, crops=True).eval()
    chosen, kinds = torch.arange(4), len(PRODUCT.parts)
    with torch.no_grad():
        nodes = data._turned(chosen, torch.zeros_like(data.present[chosen]), net)
    for place, count in enumerate(data.present[chosen].sum(1).int().tolist()):
        before, after = data.nodes[place, :count], nodes[place, :count]
        for column in (kinds + 1, kinds + 3):
            old, new = before[:, column : column + 2], after[:, column : column + 2]
            assert torch.allclose(torch.cdist(old, old), torch.cdist(new, new), atol=1e-4)
        seen = mirrored(maps[place][list(order_of(scenes[place]))])
        flips = [net.crops.of_maps(torch.from_numpy(some) / 255.0) for some in seen]  # type: ignore[union-attr]
        for number, row in enumerate(after[:, -EMBEDDING:]):
            assert any(torch.allclose(row, some[number], atol=1e-5) for some in flips)


def test_untrained_decoder_speaks_in_sentences(scenes: list[Scene]) -> None:
    import torch

    from bracket_lab.learned.grasp.paper import PaperNet, graph_data

    torch.manual_seed(1)
    data = graph_data(scenes, PRODUCT)
    net = PaperNet(len(PRODUCT.parts), 16, 2, features=data.nodes.shape[-1]).eval()
    with torch.no_grad():
        _, words = net(data.nodes, data.weights, data.present)
    for scene, sentence in zip(scenes, words.tolist(), strict=True):
        boxes = boxes_of(scene.parts, PRODUCT).take(order_of(scene))
        plan = decode(sentence, boxes, list(PRODUCT.parts), 0)
        assert len(set(plan.moves)) == len(plan.moves)
        assert 0 not in plan.moves


def test_words_of_the_data_are_the_solutions(scenes: list[Scene]) -> None:
    from bracket_lab.learned.grasp.paper import graph_data

    data = graph_data(scenes[:1], PRODUCT)
    names = list(PRODUCT.parts)
    types = [names.index(name) for name in scenes[0].boxes.types]
    for place, part in enumerate(order_of(scenes[0])):
        assert data.words[0, place].tolist() == encode(scenes[0].solution(part), types)
        assert bool(data.graspable[0, place]) == scenes[0].graspable(part)
    assert data.words.shape[-1] == MAX_WORDS


def test_the_papers_planner_wants_a_camera(tmp_path: Path) -> None:
    from bracket_lab.learned.grasp.train import train_grasp

    with pytest.raises(InputError, match="a camera is needed"):
        train_grasp(PRODUCT, tmp_path / "paper.onnx", 0, "paper", settings=SHORT_PAPER, quiet=True)


@pytest.mark.long
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
    from bracket_lab.learned.grasp.train import train_grasp

    with pytest.raises(InputError, match="pairwise, paper"):
        train_grasp(PRODUCT, tmp_path / "rule.onnx", 0, "rule")


@pytest.mark.filterwarnings("ignore::FutureWarning", "ignore::DeprecationWarning")
def test_a_layer_is_the_weighted_convolution_of_a_library() -> None:
    """Eq. 5 against GraphConv of PyTorch Geometric, which sends along lists of edges."""
    import torch
    from torch_geometric.nn import GraphConv

    from bracket_lab.learned.grasp.paper import GraphConvolution

    torch.manual_seed(2)
    ours, theirs = GraphConvolution(4, 5), GraphConv(4, 5)
    theirs.lin_root.weight, theirs.lin_rel.weight = ours.own.weight, ours.neighbours.weight
    theirs.lin_rel.bias = ours.own.bias
    nodes, weights = torch.rand(7, 4), torch.rand(7, 7) * (torch.rand(7, 7) < 0.5)
    receivers, senders = weights.nonzero(as_tuple=True)
    with torch.no_grad():
        expected = theirs(nodes, torch.stack([senders, receivers]), weights[receivers, senders])
        assert torch.allclose(ours(nodes[None], weights[None])[0], expected, atol=1e-6)
