"""Fits the networks of the semantic planners; an interrupted fit goes on where it was. Imports torch."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from rich.console import Console
from rich.progress import track
from torch import Tensor, nn

from learned.semantic.factored import FactoredNetwork, FactoredSettings
from learned.semantic.graph import Layout
from learned.semantic.losses import Counts, factored_loss, goal_prior, paper_loss
from learned.semantic.paper import PaperNetwork, PaperSettings
from learned.semantic.scenarios import Scenarios, misdetect

CHECKPOINT_STEPS = 100  # between two checkpoints

Settings = PaperSettings | FactoredSettings


def fit(
    layout: Layout,
    train: Scenarios,
    settings: Settings,
    seed: int,
    *,
    checkpoint: Path | None = None,
    quiet: bool = True,
) -> nn.Module:
    """Train a new network: full batches, Adam with a one-cycle schedule; the paper's with fresh noise in every step.

    Args:
        checkpoint: file that keeps the state of the fit; where it is of the same data, settings and seed, the fit
            goes on from there, with the same result as if it had never stopped. Removed at the end.
    """
    torch.set_num_threads(1)  # these networks are small: a second thread only waits
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    network, loss = _task(layout, train, settings, rng)
    decay = settings.weight_decay if isinstance(settings, PaperSettings) else 0.0
    optimiser = torch.optim.Adam(network.parameters(), lr=settings.learning_rate, weight_decay=decay)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, settings.learning_rate, total_steps=settings.steps)
    keeper = _Keeper(checkpoint, _fingerprint(layout, train, settings, seed), network, optimiser, schedule, rng)
    begin = keeper.restore()
    console = Console(stderr=True)
    for step in track(range(begin, settings.steps), "Training", console=console, disable=quiet, transient=True):
        optimiser.zero_grad()
        loss().backward()  # type: ignore[no-untyped-call]
        optimiser.step()
        schedule.step()
        if (step + 1) % CHECKPOINT_STEPS == 0:
            keeper.save(step + 1)
    keeper.remove()
    return network.eval()


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


def _fingerprint(layout: Layout, train: Scenarios, settings: Settings, seed: int) -> str:
    text = f"{layout.vocabulary} {train.sha256} {type(settings).__name__} {settings.model_dump_json()} {seed}"
    return hashlib.sha256(text.encode()).hexdigest()


@dataclass(frozen=True)
class _Keeper:
    """Keeps all that a fit is made of in one file, written aside and then renamed."""

    path: Path | None
    fingerprint: str
    network: nn.Module
    optimiser: torch.optim.Optimizer
    schedule: torch.optim.lr_scheduler.LRScheduler
    rng: np.random.Generator

    def restore(self) -> int:
        """Steps that are done already: none where there is no checkpoint, or one of another fit."""
        if self.path is None or not self.path.exists():
            return 0
        kept: dict[str, Any] = torch.load(self.path, weights_only=True)
        if kept.get("fingerprint") != self.fingerprint:
            return 0
        self.network.load_state_dict(kept["network"])
        self.optimiser.load_state_dict(kept["optimiser"])
        self.schedule.load_state_dict(kept["schedule"])
        self.rng.bit_generator.state = kept["numpy"]
        torch.set_rng_state(kept["torch"])
        return int(kept["step"])

    def save(self, step: int) -> None:
        if self.path is None:
            return
        self.path.parent.mkdir(parents=True, exist_ok=True)
        partial = self.path.with_name(self.path.name + ".partial")
        kept = {
            "fingerprint": self.fingerprint,
            "step": step,
            "network": self.network.state_dict(),
            "optimiser": self.optimiser.state_dict(),
            "schedule": self.schedule.state_dict(),
            "numpy": self.rng.bit_generator.state,
            "torch": torch.get_rng_state(),
        }
        torch.save(kept, partial)
        partial.replace(self.path)

    def remove(self) -> None:
        if self.path is not None:
            self.path.unlink(missing_ok=True)
