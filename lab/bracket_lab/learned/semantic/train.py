"""Training of the semantic planners: data, fit, export, model card. Imports torch: never at run time."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from pydantic import JsonValue
from torch import Tensor, nn

from bracket_cell.learned.semantic.graph import EMPTY, Layout, one_hot
from bracket_cell.learned.semantic.records import load_demonstrations
from bracket_cell.learned.semantic.settings import FactoredSettings, PaperSettings
from bracket_ground.errors import InputError
from bracket_ground.interfaces.product import Product
from bracket_lab.learned.semantic.evaluate import evaluate_semantic
from bracket_lab.learned.semantic.misdetection import Scenarios, misdetect
from bracket_lab.learned.semantic.network import Counts, FactoredAnswer, FactoredNetwork, factored_loss, goal_prior
from bracket_lab.learned.semantic.paper import PaperAnswer, PaperNetwork, paper_loss
from bracket_lab.learned.semantic.paper_planner import load_semantic_planner
from bracket_lab.learned.semantic.scenarios import (
    TRAIN_RATIO,
    from_the_right,
    scenarios,
    split,
    states_of,
    sub_demonstrations,
)
from bracket_lab.learned.training.recipe import Recipe, Task

Settings = PaperSettings | FactoredSettings
OUTPUTS = {"paper": PaperAnswer._fields, "factored": FactoredAnswer._fields}
CHECKED_STATES = 200  # of the training states, when the export is compared with torch


@dataclass(frozen=True)
class TrainingData:
    """What is trained on and what is kept from it.

    Attributes:
        source: file of demonstrations, empty for generated scenarios.
    """

    train: Scenarios
    held_out: Scenarios
    sha256: str
    source: str = ""


def generated_data(layout: Layout, ratio: float, seed: int) -> TrainingData:
    """Scenarios of the product, `ratio` of them to train on."""
    whole = scenarios(layout, seed)
    return TrainingData(*split(whole, ratio, seed), sha256=whole.sha256)


def recorded_data(path: Path, product: Product, ratio: float, seed: int) -> TrainingData:
    """Demonstrations of a file, `ratio` of them to train on: all states of one stay together.

    Raises:
        InputError: the file has mistakes, or too few demonstrations to keep any from training.
    """
    layout = Layout.of(product)
    found = [
        demonstration for demonstration in load_demonstrations(path, product) if demonstration.goal in product.goals
    ]
    count = round(ratio * len(found))
    if not 0 < count < len(found):
        raise InputError(f"{path}: {len(found)} demonstrations are too few to hold any out; at least 3 are needed")
    order = np.random.default_rng(seed).permutation(len(found))
    train = states_of(layout, [found[i] for i in order[:count]])
    held_out = states_of(layout, [found[i] for i in order[count:]])
    begun = held_out.take(np.flatnonzero((held_out.seen != EMPTY).any(axis=1)))
    return TrainingData(train, begun, hashlib.sha256(path.read_bytes()).hexdigest(), str(path))


def train_semantic(
    product: Product,
    out: Path,
    seed: int,
    kind: str,
    *,
    ratio: float = TRAIN_RATIO,
    augment: bool = False,
    data: Path | None = None,
    settings: Settings | None = None,
    quiet: bool = False,
) -> dict[str, float]:
    """Train a planner, write it to `out` with its model card, and score it on what was held out.

    Args:
        kind: "paper" or "factored".
        ratio: share of the scenarios, or of the demonstrations, that is trained on.
        augment: train on sub-demonstrations too.
        data: file of demonstrations; generated scenarios without.
        settings: of another network or training than the default.
        quiet: no progress bar.

    Returns:
        Scores by name, the same as in the model card.

    Raises:
        InputError: no such kind, or mistakes in the file of demonstrations.
        ModelError: the exported network does not answer as the trained one does.
    """
    if kind not in OUTPUTS:
        raise InputError(f"cannot train a semantic planner {kind!r}; there are {', '.join(OUTPUTS)}")
    layout = Layout.of(product)
    some = generated_data(layout, ratio, seed) if data is None else recorded_data(data, product, ratio, seed)
    train = sub_demonstrations(layout, some.train) if augment else some.train
    if kind == "paper" and data is None:  # section 4.1: its experts always place the first missing part from the right
        train = from_the_right(train)
    chosen = settings or (PaperSettings() if kind == "paper" else FactoredSettings())
    config: dict[str, JsonValue] = {"ratio": ratio, "augment": augment, "states": len(train), "data": some.source}

    def score() -> dict[str, float]:
        held_out = some.held_out if some.source else None
        return evaluate_semantic(load_semantic_planner(kind, out, product), product, seed, held_out)

    task = Task(out=out, seed=seed, command=_command(kind, seed, ratio, augment, data), quiet=quiet)
    recipe = replace(semantic_recipe(layout, train, chosen, seed), more=config, data_sha256=some.sha256)
    recipe.fit(task)
    samples = [{"edges": edges} for edges in one_hot(train.seen[:CHECKED_STATES], len(layout.parts))]
    return recipe.write(task, OUTPUTS[kind], samples, score)


def semantic_recipe(layout: Layout, train: Scenarios, settings: Settings, seed: int) -> Recipe:
    """A new network, to be trained on full batches; the paper's with fresh noise in every step."""
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    network, loss = _task(layout, train, settings, rng)
    return Recipe(
        kind="semantic.paper" if isinstance(settings, PaperSettings) else "semantic.factored",
        network=network,
        losses=lambda _: [loss()],
        epochs=settings.steps,
        batches=1,
        rate=settings.learning_rate,
        decay=settings.weight_decay,
        settings=settings,
        vocabulary=layout.vocabulary,
        data_sha256=train.sha256,
        rng=rng,
        gradient=None,
        optimiser=torch.optim.Adam,
    )


def train_network(layout: Layout, train: Scenarios, settings: Settings, seed: int) -> nn.Module:
    """A trained network that is not written."""
    recipe = semantic_recipe(layout, train, settings, seed)
    recipe.fit(Task(seed=seed))
    return recipe.network


def _task(
    layout: Layout, train: Scenarios, settings: Settings, rng: np.random.Generator
) -> tuple[nn.Module, Callable[[], Tensor]]:
    """A new network and what its loss is in every step."""
    if isinstance(settings, PaperSettings):
        paper = PaperNetwork(layout, settings)
        noise = settings.noise
        return paper, lambda: paper_loss(paper, layout, misdetect(layout, train, rng, noise, contradicting=True))
    factored = FactoredNetwork(layout, settings)
    factored.get_buffer("prior").copy_(goal_prior(layout, train, settings))
    counts = Counts.of(layout, train)
    return factored, lambda: factored_loss(factored, counts, settings)


def _command(kind: str, seed: int, ratio: float, augment: bool, data: Path | None) -> str:
    options = [f"--kind {kind}", f"--seed {seed}"]
    options += [f"--ratio {ratio}"] if ratio != TRAIN_RATIO else []
    options += ["--augment"] if augment else []
    options += [f"--data {data}"] if data is not None else []
    return " ".join(["cell lab train semantic", *options])
