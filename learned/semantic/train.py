"""Training of the semantic planners on generated scenarios; minutes on a CPU. Imports torch: never at run time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import onnx
import torch
from rich.console import Console
from rich.progress import track
from torch import Tensor, nn

from cell.interfaces.errors import InputError, ModelError
from cell.interfaces.product import Product
from learned.onnx_model import ModelCard, OnnxModel, save_onnx
from learned.semantic.evaluate import evaluate_semantic
from learned.semantic.factored import FactoredNetwork, FactoredSettings
from learned.semantic.graph import EMPTY, Ints, Layout, one_hot
from learned.semantic.paper import PaperNetwork, PaperSettings
from learned.semantic.planner import load_semantic_planner
from learned.semantic.scenarios import (
    TRAIN_RATIO,
    Scenarios,
    misdetect,
    scenarios,
    split,
    sub_demonstrations,
    unknown_goals,
)

TOLERANCE = 1e-5  # ONNX and torch agree within
IGNORED = -100  # label of what no loss looks at, as cross_entropy has it

Settings = PaperSettings | FactoredSettings


def train_semantic(
    product: Product,
    out: Path,
    seed: int,
    kind: str,
    *,
    ratio: float = TRAIN_RATIO,
    augment: bool = False,
    settings: Settings | None = None,
    quiet: bool = False,
) -> dict[str, float]:
    """Train a planner, write it to `out` as ONNX with its model card, and score it on the held-out scenarios.

    Args:
        kind: "paper" or "factored".
        ratio: share of the scenarios that is trained on.
        augment: train on sub-demonstrations too.
        settings: of another kind of network or training than the default.
        quiet: no progress bar.

    Returns:
        Scores by name, the same as in the model card.

    Raises:
        InputError: no such kind.
        ModelError: the exported network does not answer as the trained one does.
    """
    if kind not in ("paper", "factored"):
        raise InputError(f"cannot train a semantic planner {kind!r}; there are paper, factored")
    layout = Layout.of(product)
    whole = scenarios(layout, seed)
    train, _ = split(whole, ratio, seed)
    if augment:
        train = sub_demonstrations(layout, train)
    chosen = settings or (PaperSettings() if kind == "paper" else FactoredSettings())
    network = fit(layout, train, chosen, seed, quiet=quiet)
    card = ModelCard(
        kind=f"semantic.{kind}",
        config={"ratio": ratio, "augment": augment, "scenarios": len(train), **chosen.model_dump()},
        vocabulary=layout.vocabulary,
        data_sha256=whole.sha256,
        command=f"cell train semantic --kind {kind} --seed {seed}",
        seed=seed,
    )
    export(network, train, out, card)
    scores = evaluate_semantic(load_semantic_planner(kind, out, product), product, seed)
    save_onnx(onnx.load(out), out, card.model_copy(update={"scores": scores}))
    return scores


def fit(layout: Layout, train: Scenarios, settings: Settings, seed: int, *, quiet: bool = True) -> nn.Module:
    """Train a new network: full batches, fresh noise in every step, Adam with a one-cycle schedule."""
    torch.set_num_threads(1)  # these networks are small: a second thread only waits
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    if isinstance(settings, PaperSettings):
        paper = PaperNetwork(layout, settings)
        network: nn.Module = paper
        decay = settings.weight_decay

        def loss() -> Tensor:
            return _paper_loss(paper, layout, misdetect(layout, train, rng, settings.noise, contradicting=True))
    else:
        factored = FactoredNetwork(layout)
        network, decay = factored, 0.0

        def loss() -> Tensor:
            return _factored_loss(factored, layout, train, settings, rng)

    _descend(network, loss, settings, decay, quiet)
    return network.eval()


def export(network: nn.Module, train: Scenarios, out: Path, card: ModelCard) -> None:
    """Write ONNX and check it against torch on the training states.

    Raises:
        ModelError: an output differs by more than TOLERANCE.
    """
    parts = len(card.vocabulary["parts"])
    edges = one_hot(train.seen, parts)
    names = ["belief", "following", "words"] if card.kind == "semantic.paper" else ["belief", "wanted", "following"]
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


def _descend(
    network: nn.Module, loss: Callable[[], Tensor], settings: Settings, weight_decay: float, quiet: bool
) -> None:
    optimiser = torch.optim.Adam(network.parameters(), lr=settings.learning_rate, weight_decay=weight_decay)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, settings.learning_rate, total_steps=settings.steps)
    for _ in _steps(settings.steps, quiet):
        optimiser.zero_grad()
        loss().backward()  # type: ignore[no-untyped-call]
        optimiser.step()
        schedule.step()


def _paper_loss(network: PaperNetwork, layout: Layout, batch: Scenarios) -> Tensor:
    """Cross-entropies of goal, next object and plan words; the heads are given the true goal (teacher forcing)."""
    parts = len(layout.parts)
    goals = torch.tensor(batch.goals)
    graph = network.embed(torch.tensor(one_hot(batch.seen, parts)))
    hard = nn.functional.one_hot(goals, len(layout.goals)).float()
    following = torch.tensor(layout.types[batch.goals, batch.following])
    words = torch.tensor(plan_words(layout, batch)).reshape(len(batch) * parts, -1)
    logits = network.teach(
        graph.repeat_interleave(parts, dim=0), hard.repeat_interleave(parts, dim=0), words[:, :-1].clamp(min=0)
    )
    entropy = nn.functional.cross_entropy
    return (
        entropy(network.goal_head(graph), goals)
        + entropy(network.following(graph, hard), following)
        + entropy(logits.flatten(0, 1), words[:, 1:].flatten(), ignore_index=IGNORED)
    )


def plan_words(layout: Layout, batch: Scenarios) -> Ints:
    """(B, n, 2 + most of a type) words of every object's plan: its name, its open positions in order, the end."""
    rows, parts, end = len(batch), len(layout.parts), len(layout.words) - 1
    words = np.full((rows, parts, int(layout.quantities.max()) + 2), IGNORED)
    words[:, :, 0] = np.arange(parts)
    still = layout.wanted[batch.goals].astype(bool) & (batch.seen == EMPTY)[:, None, :]
    row, part, position = np.nonzero(still)
    words[row, part, still.cumsum(axis=2)[row, part, position]] = parts + position
    np.put_along_axis(words, 1 + still.sum(axis=2, keepdims=True), end, axis=2)
    return words


def _factored_loss(
    network: FactoredNetwork,
    layout: Layout,
    train: Scenarios,
    settings: FactoredSettings,
    rng: np.random.Generator,
) -> Tensor:
    """Cross-entropies of goal (with states of unknown goals), of the slots that plans name, and of the next slot."""
    parts, goals = len(layout.parts), len(layout.goals)
    known = misdetect(layout, train, rng, settings.noise, contradicting=True)
    others = unknown_goals(layout, rng.permutation(train.seen) != EMPTY, rng)
    seen = np.concatenate([known.seen, misdetect(layout, others, rng, settings.noise).seen])
    labels = torch.tensor(np.concatenate([known.goals, others.goals]))
    weights = torch.ones(goals + 1)
    weights[-1] = settings.unknown / (1.0 - settings.unknown)
    entropy = nn.functional.cross_entropy
    goal = entropy(network.goal_logits(torch.tensor(one_hot(seen, parts))), labels, weights)

    named = torch.tensor(np.where(train.seen == EMPTY, layout.types[train.goals], IGNORED))
    table = nn.functional.nll_loss(network.log_table()[torch.tensor(train.goals)], named, ignore_index=IGNORED)

    rows = torch.arange(len(train))
    slots = network.next_slot(torch.tensor(one_hot(train.seen, parts)))
    order = -torch.log(slots[rows, torch.tensor(train.goals), torch.tensor(train.following)]).mean()
    return goal + table + order + settings.habit_decay * network.rest.square().sum()


def _steps(count: int, quiet: bool) -> Iterator[int]:
    yield from track(range(count), "Training", console=Console(stderr=True), disable=quiet, transient=True)
