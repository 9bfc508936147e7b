"""One trainer for every network: a recipe says what is fitted and what is written; the rest is the same for all.

A training is resumable: what is half done lies beside the weights until they are written. Imports torch.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import torch
from pydantic import JsonValue
from torch import Tensor, nn

from bracket_cell.learned.inference.onnx_model import Inputs, ModelCard
from bracket_ground.files.model import Model
from bracket_lab.learned.training.schedule import Schedule
from bracket_lab.learned.training.torch_model import TOLERANCE, TorchModel, write_weights
from bracket_lab.learned.training.training_loop import LARGEST_GRADIENT, Checkpoint, fit

Example = TypeVar("Example")
Losses = Callable[[int], Iterable[Tensor]]


@dataclass(frozen=True, kw_only=True)
class Task:
    """One training as it is asked for.

    Attributes:
        out: the ONNX file; None for a network that is not written.
        command: what was typed, for the model card.
        quiet: no progress bar.
    """

    out: Path | None = None
    seed: int = 0
    command: str = ""
    quiet: bool = True

    def beside(self, out: Path) -> Task:
        """The same for another file."""
        return Task(out=out, seed=self.seed, command=self.command, quiet=self.quiet)


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """What is trained, on what, and how.

    Attributes:
        kind: on the card.
        network: untrained; made after `torch.manual_seed`.
        losses: those of the batches of an epoch, each computed when its turn comes.
        epochs, batches: how often they are asked for, and how many there are.
        rate, decay: peak of the learning rate, and weight decay.
        settings, vocabulary, data_sha256: on the card; settings and data also tell one training from another.
        rng: that the losses draw from.
        gradient: norm to which gradients are clipped.
        stays: the checkpoint stays when the file is written: other files of this training are still to come.
        more: of the card's config.
        optimiser: makes the optimiser of parameters.
        device: what it is trained on, to which the losses bring their batches.
    """

    kind: str
    network: nn.Module
    losses: Losses
    epochs: int
    batches: int
    rate: float
    decay: float
    settings: Model
    vocabulary: Mapping[str, tuple[str, ...]]
    data_sha256: str
    rng: np.random.Generator | None = None
    gradient: float | None = LARGEST_GRADIENT
    stays: bool = False
    more: Mapping[str, JsonValue] = field(default_factory=dict)
    optimiser: Callable[..., torch.optim.Optimizer] = torch.optim.AdamW
    device: torch.device | str = "cpu"

    @property
    def identity(self) -> str:
        """What tells this training from another."""
        return f"{self.kind} {self.settings.model_dump_json()} {self.epochs} {dict(self.vocabulary)} {self.data_sha256}"

    def fit(self, task: Task) -> None:
        """Train the network in place; interrupted and begun again it gets the same weights as in one go."""
        path = checkpoint_of(task.out) if task.out is not None else None
        kept = None if path is None else Checkpoint(path, f"{self.identity} {task.seed}")
        self.network.to(self.device)
        optimiser = self.optimiser(self.network.parameters(), lr=self.rate, weight_decay=self.decay)
        fit(
            self.network,
            optimiser,
            self.losses,
            self.epochs,
            self.batches,
            largest_gradient=self.gradient,
            rng=self.rng,
            checkpoint=kept,
            quiet=task.quiet,
        )
        self.network.to("cpu").to(memory_format=torch.contiguous_format)
        self.network.eval()

    def card(self, task: Task, scores: Mapping[str, float] | None = None) -> ModelCard:
        """What the weights are."""
        return ModelCard(
            kind=self.kind,
            config={**self.settings.model_dump(mode="json"), **self.more},
            vocabulary=dict(self.vocabulary),
            data_sha256=self.data_sha256,
            scores=dict(scores or {}),
            command=task.command or f"train {self.kind}",
            seed=task.seed,
        )

    def write(
        self,
        task: Task,
        outputs: Sequence[str],
        samples: Iterable[Inputs],
        score: Callable[[], dict[str, float]],
        *,
        answer: nn.Module | None = None,
        any_rows: bool = False,
        tolerance: float = TOLERANCE,
        **how: Any,
    ) -> dict[str, float]:
        """Export the network, or what answers with it, seal it, and score what was written; returns the scores.

        The checkpoint is removed after that: a training whose file is refused goes on from it.

        Args:
            answer: what is exported; the network itself where None.
            how: see `write_weights`.
        """
        assert task.out is not None
        model = TorchModel((answer or self.network).eval(), outputs, self.card(task))
        scores = write_weights(model, task.out, samples, score, any_rows=any_rows, tolerance=tolerance, **how)
        if not self.stays:
            checkpoint_of(task.out).unlink(missing_ok=True)
        return scores


def checkpoint_of(out: Path) -> Path:
    """Where an unfinished training is kept."""
    return out.with_name(f"{out.name}.checkpoint")


def on_examples(
    examples: Sequence[Example], loss: Callable[[list[Example]], Tensor], schedule: Schedule, rng: np.random.Generator
) -> dict[str, Any]:
    """Of a recipe: batches of examples, in another order in every epoch, by a schedule.

    Args:
        loss: of some examples.
        rng: orders the examples; the loss may draw from it, too.
    """
    batches = max(1, len(examples) // schedule.batch)

    def losses(_: int) -> Iterator[Tensor]:
        order = rng.permutation(len(examples))[: batches * schedule.batch]
        for chosen in np.array_split(order, batches):
            yield loss([examples[index] for index in chosen])

    rates = {"rate": schedule.peak_rate, "decay": schedule.weight_decay}
    return {"losses": losses, "epochs": schedule.epochs, "batches": batches, "rng": rng, **rates}
