"""Training of action detectors, and export to ONNX. Imports torch."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from pydantic import JsonValue
from torch import Tensor, nn

from bracket_cell.learned.actions.segments import TRACK_FEATURES, SegmentReader
from bracket_cell.learned.actions.settings import TRAINABLE, ActionTraining, Classes
from bracket_cell.learned.inference.onnx_model import Inputs, OnnxModel
from bracket_ground.errors import InputError
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.product import Product
from bracket_lab.learned.actions.data import Segments, asked
from bracket_lab.learned.actions.evaluate import answers, class_scores, confusion, times_s
from bracket_lab.learned.actions.network import ActionNet, Lrcn, build
from bracket_lab.learned.scores import latencies
from bracket_lab.learned.training.recipe import Recipe
from bracket_lab.learned.training.recipe import Task as Training
from bracket_lab.learned.training.training_loop import training_device

OUTPUTS = ("logits", "released")
SPEED_STEPS = 5  # after which the time of a step is known


@dataclass(frozen=True)
class Task:
    """What is learned: the bench and the product that the segments are of."""

    bench: Bench
    product: Product

    @property
    def classes(self) -> Classes:
        return Classes.of(self.product)


def train_actions(
    task: Task,
    learned: Segments,
    validation: Segments,
    out: Path,
    kind: str = "slim",
    *,
    settings: ActionTraining | None = None,
    budget_s: float | None = None,
    seed: int = 0,
    command: str = "",
    quiet: bool = True,
) -> dict[str, float]:
    """Train, write the weights with their model card, and score the written file on the validation segments.

    Args:
        out: the ONNX file; beside it an interrupted training is kept to go on from.
        budget_s: processor time; fewer epochs where that is too little.

    Returns:
        Scores by name, the same as on the model card.

    Raises:
        InputError: there is no such kind.
    """
    if kind not in TRAINABLE:
        raise InputError(f"no action detector {kind!r} can be trained; legal: {', '.join(TRAINABLE)}")
    settings, reader = settings or ActionTraining(), SegmentReader(task.bench, task.product)
    recipe = action_recipe(task, learned, kind, settings, budget_s=budget_s, seed=seed)
    asked_for = Training(out=out, seed=seed, command=command, quiet=quiet)
    recipe.fit(asked_for)
    some = asked(kind, validation, np.arange(min(8, len(validation))), reader)
    samples: list[Inputs] = [{name: values[:2] for name, values in some.items()}, some]

    facts: dict[str, JsonValue] = {}

    def score() -> dict[str, float]:
        written = OnnxModel.load(out, recipe.kind)
        posterior, _ = answers(written, validation, reader, noise_seed=0)
        counts = confusion(validation, posterior, task.classes).tolist()
        facts["confusion"] = {"classes": list(task.classes.names), "counts": counts}
        return class_scores(validation, posterior, task.classes) | latencies(times_s(written, validation, reader))

    return recipe.write(asked_for, OUTPUTS, samples, score, any_rows=True, told=facts)


def action_recipe(
    task: Task,
    learned: Segments,
    kind: str,
    settings: ActionTraining,
    *,
    budget_s: float | None = None,
    seed: int = 0,
) -> Recipe:
    """An untrained network, with the epochs that there is time for."""
    torch.manual_seed(seed)
    network = build(kind, len(task.classes.parts), len(task.classes.positions), settings.share)
    rng = np.random.default_rng([seed, 1])
    learner = _Learner(kind, network, learned, SegmentReader(task.bench, task.product), settings, rng)
    if budget_s is not None:
        affordable = int(budget_s / (learner.step_s() * learner.batches))
        settings = settings.model_copy(update={"epochs": max(1, min(settings.epochs, affordable))})
    return Recipe(
        kind=f"actions.{kind}",
        network=network,
        losses=learner.losses,
        epochs=settings.epochs,
        batches=learner.batches,
        rate=settings.learning_rate,
        decay=settings.weight_decay,
        settings=settings,
        vocabulary={"parts": task.classes.parts, "positions": task.classes.positions},
        data_sha256=learned.sha256,
        rng=rng,
        gradient=1.0,
        device=training_device(),
        more={"network": kind, "track_features": TRACK_FEATURES},
    )


@dataclass
class _Learner:
    """Draws batches, varied anew in each epoch."""

    kind: str
    network: ActionNet | Lrcn
    segments: Segments
    reader: SegmentReader
    settings: ActionTraining
    rng: np.random.Generator

    @property
    def batches(self) -> int:
        return max(1, len(self.segments) // self.settings.batch)

    def losses(self, epoch: int) -> Iterator[Tensor]:
        """The loss of each batch of an epoch."""
        del epoch
        self.network.train()
        order = self.rng.permutation(len(self.segments))
        for number in range(self.batches):
            yield self._loss(order[number * self.settings.batch : (number + 1) * self.settings.batch])

    def step_s(self) -> float:
        """Processor time of a step."""
        torch.set_num_threads(1)
        self.network.to(training_device())
        state = self.rng.bit_generator.state
        began_s = time.process_time()
        for _ in range(SPEED_STEPS):
            torch.autograd.backward(self._loss(self.rng.permutation(len(self.segments))[: self.settings.batch]))
        self.network.zero_grad()
        self.rng.bit_generator.state = state
        return (time.process_time() - began_s) / SPEED_STEPS

    def _loss(self, chosen: np.ndarray[tuple[int, ...], np.dtype[np.int64]]) -> Tensor:
        inputs = asked(self.kind, self.segments, chosen, self.reader, self.rng)
        device = next(self.network.parameters()).device
        logits, released = self.network(*(torch.from_numpy(values).to(device) for values in inputs.values()))
        wanted = torch.from_numpy(self.segments.classes[chosen]).to(device)
        loss = nn.functional.cross_entropy(logits, wanted, label_smoothing=0.02)
        placing = wanted < logits.shape[1] - 3
        if bool(placing.any()):
            opened = torch.from_numpy(self.segments.released[chosen]).float().to(device)
            each = nn.functional.binary_cross_entropy_with_logits(released, opened, reduction="none")
            loss = loss + self.settings.released_weight * (each * placing).sum() / placing.sum()
        return loss
