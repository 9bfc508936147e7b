"""The training loop: AdamW on a one-cycle schedule, repeatable, and resumable after an interruption."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import torch
from rich.console import Console
from rich.progress import track
from torch import Tensor, nn

from learned.grasp.training_settings import TrainingSettings

_SAVED_EVERY = 5  # epochs
_Stateful = nn.Module | torch.optim.Optimizer | torch.optim.lr_scheduler.LRScheduler


def fit(
    net: nn.Module,
    count: int,
    loss: Callable[[Tensor], Tensor],
    settings: TrainingSettings,
    seed: int,
    console: Console,
    checkpoint: Path | None = None,
) -> None:
    """Train a network in place; interrupted and begun again it gives the same weights as in one go.

    Args:
        count: samples in the data.
        loss: of samples chosen by their numbers (batch,).
        checkpoint: where the state is kept between epochs; the file must belong to these very data and settings.
    """
    steps = -(-count // settings.batch)
    optimiser = torch.optim.AdamW(net.parameters(), settings.peak_rate, weight_decay=settings.weight_decay)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, settings.peak_rate, total_steps=settings.epochs * steps)
    state: dict[str, _Stateful] = {"net": net, "optimiser": optimiser, "schedule": schedule}
    first = _resumed(checkpoint, state)
    for epoch in track(range(first, settings.epochs), "training", console=console, transient=True):
        torch.manual_seed(seed * 100_003 + epoch)
        for chosen in torch.split(torch.randperm(count), settings.batch):
            optimiser.zero_grad()
            torch.autograd.backward(loss(chosen))
            nn.utils.clip_grad_norm_(net.parameters(), 1.0)
            optimiser.step()
            schedule.step()
        if checkpoint is not None and (epoch + 1) % _SAVED_EVERY == 0:
            _save(checkpoint, state, epoch + 1)


def _resumed(checkpoint: Path | None, state: dict[str, _Stateful]) -> int:
    """The epoch to go on with."""
    if checkpoint is None or not checkpoint.exists():
        return 0
    saved = torch.load(checkpoint, weights_only=True)
    for name, part in state.items():
        part.load_state_dict(saved[name])
    return int(saved["epoch"])


def _save(checkpoint: Path, state: dict[str, _Stateful], epoch: int) -> None:
    checkpoint.parent.mkdir(parents=True, exist_ok=True)
    partial = checkpoint.with_name(checkpoint.name + ".partial")
    torch.save({name: part.state_dict() for name, part in state.items()} | {"epoch": epoch}, partial)
    partial.replace(checkpoint)
