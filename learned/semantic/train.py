"""Training of the semantic planners: data, fit, export, model card. Imports torch: never at run time."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import onnx
import torch
from pydantic import JsonValue
from torch import nn

from cell.interfaces.errors import InputError, ModelError
from cell.interfaces.product import Product
from learned.onnx_model import ModelCard, OnnxModel, save_onnx
from learned.semantic.and_or import AndOrGraph
from learned.semantic.dataset import load_demonstrations, states_of
from learned.semantic.evaluate import evaluate_semantic
from learned.semantic.factored import FactoredAnswer, FactoredSettings
from learned.semantic.fit import Settings, fit
from learned.semantic.graph import EMPTY, Layout, one_hot
from learned.semantic.paper import PaperAnswer, PaperSettings
from learned.semantic.planner import load_semantic_planner
from learned.semantic.scenarios import TRAIN_RATIO, Scenarios, scenarios, split, sub_demonstrations

TOLERANCE = 1e-5  # ONNX and torch agree within
KINDS = ("paper", "factored", "and_or")
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
    found = load_demonstrations(path, product)
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
        kind: "paper", "factored" or "and_or".
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
    if kind not in KINDS:
        raise InputError(f"cannot train a semantic planner {kind!r}; there are {', '.join(KINDS)}")
    layout = Layout.of(product)
    some = generated_data(layout, ratio, seed) if data is None else recorded_data(data, product, ratio, seed)
    train = sub_demonstrations(layout, some.train) if augment else some.train
    chosen = settings or _default_settings(kind)
    config: dict[str, JsonValue] = {"ratio": ratio, "augment": augment, "states": len(train), "data": some.source}
    card = ModelCard(
        kind=f"semantic.{kind}",
        config={**config, **(chosen.model_dump() if chosen else {})},
        vocabulary=layout.vocabulary,
        data_sha256=some.sha256,
        command=_command(kind, seed, ratio, augment, data),
        seed=seed,
    )

    def scored() -> ModelCard:
        planner = load_semantic_planner(kind, out, product)
        held_out = some.held_out if some.source else None
        return card.model_copy(update={"scores": evaluate_semantic(planner, product, seed, held_out)})

    if chosen is None:
        AndOrGraph.of(layout, train, card).save(out)
        card = scored()
        AndOrGraph.of(layout, train, card).save(out)
    else:
        checkpoint = out.with_name(out.name + ".checkpoint")
        network = fit(layout, train, chosen, seed, checkpoint=checkpoint, quiet=quiet)
        export(network, train, out, card)
        card = scored()
        save_onnx(onnx.load(out), out, card)
    return card.scores


def export(network: nn.Module, train: Scenarios, out: Path, card: ModelCard) -> None:
    """Write ONNX and check it against torch on training states.

    Raises:
        ModelError: an output differs by more than TOLERANCE.
    """
    edges = one_hot(train.seen[:CHECKED_STATES], len(card.vocabulary["parts"]))
    names = list(PaperAnswer._fields if card.kind == "semantic.paper" else FactoredAnswer._fields)
    program = torch.onnx.export(
        network,
        (torch.tensor(edges[0]),),
        input_names=["edges"],
        output_names=names,
        dynamo=True,
        verbose=False,
    )
    if program is None:
        raise ModelError(f"{out}: torch exported nothing")
    save_onnx(program.model_proto, out, card)
    model = OnnxModel.load(out, card.kind)
    for row in edges:
        with torch.no_grad():
            expected = dict(zip(names, network(torch.tensor(row)), strict=True))
        for name, value in model.run({"edges": row}).items():
            difference = float(np.abs(value - expected[name].numpy()).max())
            if difference > TOLERANCE:
                raise ModelError(f"{out}: output {name} differs from torch by {difference:.1e}, more than {TOLERANCE}")


def _default_settings(kind: str) -> Settings | None:
    if kind == "and_or":
        return None
    return PaperSettings() if kind == "paper" else FactoredSettings()


def _command(kind: str, seed: int, ratio: float, augment: bool, data: Path | None) -> str:
    options = [f"--kind {kind}", f"--seed {seed}"]
    options += [f"--ratio {ratio}"] if ratio != TRAIN_RATIO else []
    options += ["--augment"] if augment else []
    options += [f"--data {data}"] if data is not None else []
    return " ".join(["cell train semantic", *options])
