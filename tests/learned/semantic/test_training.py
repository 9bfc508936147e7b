"""Networks of the semantic planners in torch: laws of the graph layers, training, export. No OpenGL in this process."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from cell.interfaces.errors import InputError
from learned.onnx_model import OnnxModel
from learned.semantic.graph import EMPTY, Layout, one_hot
from learned.semantic.planner import load_semantic_planner
from learned.semantic.scenarios import scenarios, split
from tests.learned.products import DEFAULT, HARDER, relabelled

if TYPE_CHECKING:
    from learned.semantic.factored import FactoredSettings
    from learned.semantic.paper import PaperSettings

pytestmark = [pytest.mark.torch, pytest.mark.filterwarnings("ignore::DeprecationWarning:torch.*")]

LAYOUT = Layout.of(DEFAULT)


def short(kind: str) -> PaperSettings | FactoredSettings:
    """Settings that train in a second or two."""
    from learned.semantic.factored import FactoredSettings
    from learned.semantic.paper import PaperSettings

    return PaperSettings(hidden=32, steps=200, learning_rate=0.01) if kind == "paper" else FactoredSettings(steps=80)


@pytest.mark.parametrize("direction", ["both", "position_to_object", "object_to_position"])
@pytest.mark.parametrize("aggregation", ["mean", "sum"])
def test_relabelling_nodes_permutes_what_a_layer_says_of_them(direction: str, aggregation: str) -> None:
    import torch

    from learned.semantic.paper import PaperNetwork, PaperSettings, SageLayer

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

    from learned.semantic.paper import PaperNetwork, PaperSettings

    edges = torch.zeros(1, 3, 6)
    edges[0, 1, 4] = 1.0
    to_object = PaperNetwork(LAYOUT, PaperSettings(direction="position_to_object")).adjacency(edges)
    assert to_object.nonzero().tolist() == [[0, 1, 3 + 4]]
    to_position = PaperNetwork(LAYOUT, PaperSettings(direction="object_to_position")).adjacency(edges)
    assert torch.equal(to_position, to_object.transpose(1, 2))
    both = PaperNetwork(LAYOUT, PaperSettings(direction="both")).adjacency(edges)
    assert torch.equal(both, to_object + to_position)


def test_plans_as_words_name_the_open_slots_in_order() -> None:
    from learned.semantic.losses import IGNORED, plan_words

    whole = scenarios(LAYOUT, 0)
    end = len(LAYOUT.words) - 1
    for seen, goal, plans in zip(whole.seen, whole.goals, plan_words(LAYOUT, whole), strict=True):
        for part, plan in enumerate(plans.tolist()):
            still = [3 + i for i in range(6) if seen[i] == EMPTY and LAYOUT.types[goal, i] == part]
            assert [word for word in plan if word != IGNORED] == [part, *still, end]


@pytest.mark.parametrize("kind", ["paper", "factored"])
def test_onnx_answers_as_torch_does_on_states_it_never_saw(kind: str, tmp_path: Path) -> None:
    import torch

    from learned.onnx_model import ModelCard
    from learned.semantic.fit import fit
    from learned.semantic.train import export

    whole = scenarios(LAYOUT, 0)
    train, held_out = split(whole, 0.5, 0)
    network = fit(LAYOUT, train, short(kind), seed=0)
    path = tmp_path / "planner.onnx"
    card = ModelCard(kind=f"semantic.{kind}", vocabulary=LAYOUT.vocabulary, data_sha256="", command="", seed=0)
    export(network, train, path, card)
    model = OnnxModel.load(path, f"semantic.{kind}")
    for edges in one_hot(held_out.seen, 3):
        found = model.run({"edges": edges})
        with torch.no_grad():
            expected = network(torch.tensor(edges))
        assert set(found) == set(expected._fields)
        for name, value in expected._asdict().items():
            assert np.abs(found[name] - value.numpy()).max() <= 1e-5, name


@pytest.mark.parametrize("kind", ["paper", "factored"])
def test_training_on_another_product(kind: str, tmp_path: Path) -> None:
    from learned.semantic.train import train_semantic

    out = tmp_path / "planner.onnx"
    scores = train_semantic(HARDER, out, 3, kind, settings=short(kind), quiet=True)
    assert np.isclose(scores["bound_all"], 180 / 186)
    assert scores["success_all"] > (0.6 if kind == "paper" else 0.96)
    plan = load_semantic_planner(kind, out, HARDER).plan(LAYOUT.state(scenarios(LAYOUT, 0).seen[0]))
    assert set(plan.guidance) == set(HARDER.parts)


def test_the_same_seed_trains_the_same_weights(tmp_path: Path) -> None:
    from learned.semantic.train import train_semantic

    for kind in ("paper", "factored"):
        hashes = set()
        for run in ("a", "b"):
            train_semantic(DEFAULT, tmp_path / run, 5, kind, settings=short(kind), quiet=True)
            hashes.add(OnnxModel.load(tmp_path / run, f"semantic.{kind}").sha256)
        assert len(hashes) == 1


def test_relabelling_the_product_permutes_what_the_factored_planner_learns() -> None:
    import torch

    from learned.semantic.factored import FactoredNetwork, FactoredSettings
    from learned.semantic.fit import fit

    parts, positions = [2, 0, 1], [3, 5, 0, 1, 4, 2]
    other = Layout.of(relabelled(DEFAULT, parts, positions))
    settings = FactoredSettings(steps=40)
    here, _ = split(scenarios(LAYOUT, 0), 0.3, 0)
    renumbered = np.append(np.argsort(parts), EMPTY)[here.seen][:, positions]
    there = type(here)(here.goals, renumbered, np.argsort(positions)[here.following])
    one, two = fit(LAYOUT, here, settings, 0), fit(other, there, settings, 0)
    assert isinstance(one, FactoredNetwork)
    assert isinstance(two, FactoredNetwork)
    assert torch.allclose(two.table, one.table[:, parts][:, :, positions], atol=1e-4)
    assert torch.allclose(two.filled_next.own, one.filled_next.own[:, positions], atol=1e-3)
    assert torch.allclose(two.filled_first.part, one.filled_first.part[parts], atol=1e-3)


def test_no_training_for_what_is_not_learned(tmp_path: Path) -> None:
    from learned.semantic.train import train_semantic

    with pytest.raises(InputError, match="there are paper, factored, and_or"):
        train_semantic(DEFAULT, tmp_path / "planner.onnx", 0, "bayes")


def test_the_runtime_never_imports_torch() -> None:
    import subprocess
    import sys

    code = (
        "import sys, learned.semantic.planner, learned.semantic.evaluate;"
        "sys.exit(any(name in sys.modules for name in ('torch', 'onnx', 'rich')))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
