"""Networks of the semantic planners in torch: laws of the graph layers, training, export. No OpenGL in this process."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from bracket_cell.learned.inference.onnx_model import OnnxModel
from bracket_cell.learned.semantic.graph import EMPTY, Layout, one_hot
from bracket_ground.errors import InputError
from bracket_lab.learned.semantic.paper_planner import load_semantic_planner
from bracket_lab.learned.semantic.scenarios import scenarios, split
from tests.learned.products import DEFAULT, HARDER, relabelled

if TYPE_CHECKING:
    from bracket_cell.learned.semantic.settings import FactoredSettings, PaperSettings

pytestmark = [pytest.mark.torch, pytest.mark.filterwarnings("ignore::DeprecationWarning:torch.*")]

LAYOUT = Layout.of(DEFAULT)


def short(kind: str, share: float = 1.0) -> PaperSettings | FactoredSettings:
    """Settings that train in a second or two; a share of the steps is enough where nothing need be learned."""
    from bracket_cell.learned.semantic.settings import FactoredSettings, PaperSettings

    return (
        PaperSettings(hidden=32, steps=round(200 * share), learning_rate=0.01)
        if kind == "paper"
        else FactoredSettings(steps=round(80 * share))
    )


@pytest.mark.parametrize("direction", ["both", "position_to_object", "object_to_position"])
@pytest.mark.parametrize("aggregation", ["mean", "sum"])
def test_relabelling_nodes_permutes_what_a_layer_says_of_them(direction: str, aggregation: str) -> None:
    import torch

    from bracket_cell.learned.semantic.settings import PaperSettings
    from bracket_lab.learned.semantic.paper import PaperNetwork, SageLayer

    torch.manual_seed(0)
    settings = PaperSettings.model_validate({"direction": direction, "aggregation": aggregation})
    network = PaperNetwork(LAYOUT, settings)
    layer = SageLayer(4, 5, aggregation)
    edges = torch.tensor(one_hot(scenarios(LAYOUT, 0).seen[100:101], 3))
    nodes = torch.rand(1, 9, 4)
    parts, positions = torch.randperm(3), torch.randperm(6)
    order = torch.cat([parts, 3 + positions])
    with torch.no_grad():
        here = layer(nodes, network.adjacency(edges))
        there = layer(nodes[:, order], network.adjacency(edges[:, parts][:, :, positions]))
    assert torch.allclose(there, here[:, order], atol=1e-6)


def test_messages_take_the_direction_that_is_set() -> None:
    import torch

    from bracket_cell.learned.semantic.settings import PaperSettings
    from bracket_lab.learned.semantic.paper import PaperNetwork

    edges = torch.zeros(1, 3, 6)
    edges[0, 1, 4] = 1.0
    to_object = PaperNetwork(LAYOUT, PaperSettings(direction="position_to_object")).adjacency(edges)
    assert to_object.nonzero().tolist() == [[0, 1, 3 + 4]]
    to_position = PaperNetwork(LAYOUT, PaperSettings(direction="object_to_position")).adjacency(edges)
    assert torch.equal(to_position, to_object.transpose(1, 2))
    both = PaperNetwork(LAYOUT, PaperSettings(direction="both")).adjacency(edges)
    assert torch.equal(both, to_object + to_position)


def test_plans_as_words_name_the_open_slots_in_order() -> None:
    from bracket_lab.learned.semantic.paper import IGNORED, plan_words

    whole = scenarios(LAYOUT, 0)
    end = len(LAYOUT.words) - 1
    for seen, goal, plans in zip(whole.seen, whole.goals, plan_words(LAYOUT, whole), strict=True):
        for part, plan in enumerate(plans.tolist()):
            still = [3 + i for i in range(6) if seen[i] == EMPTY and LAYOUT.types[goal, i] == part]
            assert [word for word in plan if word != IGNORED] == [part, *still, end]


@pytest.mark.parametrize("aggregation", ["mean", "sum"])
@pytest.mark.filterwarnings("ignore::FutureWarning", "ignore::DeprecationWarning")
def test_a_layer_is_the_graphsage_layer_of_a_library(aggregation: str) -> None:
    """Eq. 2 against SAGEConv of PyTorch Geometric, which sends along lists of edges."""
    import torch
    from torch_geometric.nn import SAGEConv

    from bracket_lab.learned.semantic.paper import SageLayer

    torch.manual_seed(1)
    ours, theirs = SageLayer(4, 5, aggregation), SAGEConv(4, 5, aggr=aggregation)
    theirs.lin_r.weight, theirs.lin_l.weight, theirs.lin_l.bias = ours.own.weight, ours.neighbours.weight, ours.own.bias
    nodes, adjacency = torch.rand(9, 4), (torch.rand(9, 9) < 0.4).float()
    receivers, senders = adjacency.nonzero(as_tuple=True)
    with torch.no_grad():
        expected = torch.relu(theirs(nodes, torch.stack([senders, receivers])))
        assert torch.allclose(ours(nodes[None], adjacency[None])[0], expected, atol=1e-6)


@pytest.mark.long
@pytest.mark.parametrize("kind", ["paper", "factored"])
def test_onnx_answers_as_torch_does_on_states_it_never_saw(kind: str, tmp_path: Path) -> None:
    from bracket_cell.learned.inference.onnx_model import ModelCard
    from bracket_lab.learned.semantic.train import OUTPUTS, train_network
    from bracket_lab.learned.training.torch_model import TorchModel, write_weights

    whole = scenarios(LAYOUT, 0)
    train, held_out = split(whole, 0.5, 0)
    card = ModelCard(kind=f"semantic.{kind}", vocabulary=LAYOUT.vocabulary, data_sha256="", command="", seed=0)
    network = TorchModel(train_network(LAYOUT, train, short(kind, 0.1), seed=0), OUTPUTS[kind], card)
    path = tmp_path / "planner.onnx"
    write_weights(network, path, [{"edges": edges} for edges in one_hot(train.seen, 3)], lambda: {"a": 1.0})
    model = OnnxModel.load(path, f"semantic.{kind}")
    assert model.card == card.model_copy(update={"scores": {"a": 1.0}})
    for edges in one_hot(held_out.seen, 3):
        found, expected = model.run({"edges": edges}), network.run({"edges": edges})
        assert set(found) == set(expected)
        for name, value in expected.items():
            assert np.abs(found[name] - value).max() <= 1e-5, name
            assert np.allclose(found[name], value, rtol=1e-4, atol=1e-30), name


@pytest.mark.long
@pytest.mark.parametrize("kind", [pytest.param("paper", marks=pytest.mark.slow), "factored"])
def test_training_on_another_product(kind: str, tmp_path: Path) -> None:
    from bracket_lab.learned.semantic.train import train_semantic

    out = tmp_path / "planner.onnx"
    scores = train_semantic(HARDER, out, 3, kind, settings=short(kind), quiet=True)
    assert np.isclose(scores["bound_all"], 180 / 186)
    assert scores["success_all"] > (0.6 if kind == "paper" else 0.96)
    plan = load_semantic_planner(kind, out, HARDER).plan(LAYOUT.state(scenarios(LAYOUT, 0).seen[0]))
    assert set(plan.guidance) == set(HARDER.parts)


@pytest.mark.slow
def test_the_same_seed_trains_the_same_weights(tmp_path: Path) -> None:
    from bracket_lab.learned.semantic.train import train_semantic

    for kind in ("paper", "factored"):
        hashes = set()
        for run in ("a", "b"):
            train_semantic(DEFAULT, tmp_path / run, 5, kind, settings=short(kind, 0.2), quiet=True)
            hashes.add(OnnxModel.load(tmp_path / run, f"semantic.{kind}").sha256)
        assert len(hashes) == 1


def test_relabelling_the_product_permutes_what_the_factored_planner_learns() -> None:
    import torch

    from bracket_cell.learned.semantic.settings import FactoredSettings
    from bracket_lab.learned.semantic.network import FactoredNetwork
    from bracket_lab.learned.semantic.train import train_network

    parts, positions = [2, 0, 1], [3, 5, 0, 1, 4, 2]
    other = Layout.of(relabelled(DEFAULT, parts, positions))
    settings = FactoredSettings(steps=40)
    here, _ = split(scenarios(LAYOUT, 0), 0.3, 0)
    renumbered = np.append(np.argsort(parts), EMPTY)[here.seen][:, positions]
    there = type(here)(here.goals, renumbered, np.argsort(positions)[here.following])
    one, two = train_network(LAYOUT, here, settings, 0), train_network(other, there, settings, 0)
    assert isinstance(one, FactoredNetwork)
    assert isinstance(two, FactoredNetwork)
    assert torch.allclose(two.table, one.table[:, parts][:, :, positions], atol=1e-4)
    assert torch.allclose(two.filled_next.own, one.filled_next.own[:, positions], atol=1e-3)
    assert torch.allclose(two.filled_first.part, one.filled_first.part[parts], atol=1e-3)


def test_without_habits_the_factored_network_is_the_exact_posterior() -> None:
    import torch

    from bracket_cell.learned.semantic.posterior import BayesPosterior, Likelihood, Noise, UnknownGoal, posterior
    from bracket_cell.learned.semantic.settings import DETECTION_ERROR, FactoredSettings
    from bracket_lab.learned.semantic.misdetection import misdetect
    from bracket_lab.learned.semantic.network import FactoredNetwork

    network = FactoredNetwork(LAYOUT, FactoredSettings())
    with torch.no_grad():
        network.table.copy_(100.0 * torch.tensor(LAYOUT.wanted))
    exact = BayesPosterior(LAYOUT)
    unknown = UnknownGoal(LAYOUT, Noise.of(LAYOUT, DETECTION_ERROR))
    for edges in one_hot(misdetect(LAYOUT, scenarios(LAYOUT, 0), np.random.default_rng(0), 0.3).seen, 3):
        with torch.no_grad():
            goals, still_open, wanted, prior, usual, _ = (value.numpy() for value in network(torch.tensor(edges)))
        found = posterior(edges, Likelihood(goals, still_open, wanted, prior, float(usual)), unknown)
        assert np.isclose(usual, 1.0)
        assert np.allclose(found.belief, exact(edges).belief, atol=1e-9)
        assert np.allclose(found.placements, exact(edges).placements, atol=1e-9)


@pytest.mark.long
def test_training_on_a_file_of_demonstrations(tmp_path: Path) -> None:
    from bracket_cell.learned.semantic.records import save_demonstrations
    from bracket_lab.learned.semantic.train import train_semantic
    from tests.learned.semantic.demonstrated import demonstrations_of

    data, out = tmp_path / "some.jsonl", tmp_path / "planner"
    save_demonstrations(data, DEFAULT, demonstrations_of(LAYOUT, scenarios(LAYOUT, 0)), "a test")
    scores = train_semantic(DEFAULT, out, 0, "factored", data=data, settings=short("factored"), quiet=True)
    planner = load_semantic_planner("factored", out, DEFAULT)
    assert f"--data {data}" in planner.card.command  # type: ignore[attr-defined]
    assert scores["consistent_success_held_out"] > 0.99
    data.write_text("\n".join(data.read_text().splitlines()[:2]))
    with pytest.raises(InputError, match="too few to hold any out"):
        train_semantic(DEFAULT, out, 0, "factored", data=data)


def test_no_training_for_what_is_not_learned(tmp_path: Path) -> None:
    from bracket_lab.learned.semantic.train import train_semantic

    with pytest.raises(InputError, match="there are paper, factored"):
        train_semantic(DEFAULT, tmp_path / "planner.onnx", 0, "bayes")


def test_the_runtime_never_imports_torch() -> None:
    import subprocess
    import sys

    code = (
        "import sys, bracket_cell.learned.semantic.model, bracket_lab.learned.semantic.evaluate;"
        "sys.exit(any(name in sys.modules for name in ('torch', 'onnx', 'rich')))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
