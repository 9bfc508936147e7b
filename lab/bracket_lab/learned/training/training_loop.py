"""The training loop of every network: one-cycle schedule, repeatable, resumable if interrupted. Imports torch."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from torch import Tensor, nn
from torch.utils.data import DataLoader, Dataset

from bracket_ground.files.files import write_whole

CHECKPOINTS = 20  # in the course of a fit
LARGEST_GRADIENT = 5.0
FEEDERS = 5  # processes that make batches for a GPU

_Stateful = nn.Module | torch.optim.Optimizer | torch.optim.lr_scheduler.LRScheduler


@dataclass(frozen=True)
class Checkpoint:
    """Where a fit is kept until its weights are written, and whose it is: data, settings and seed in words.

    Whoever writes the last file of the training removes it, not the fit.
    """

    path: Path
    identity: str

    @property
    def fingerprint(self) -> str:
        """Hash of the identity."""
        return hashlib.sha256(self.identity.encode()).hexdigest()


def fit(
    network: nn.Module,
    optimiser: torch.optim.Optimizer,
    losses: Callable[[int], Iterable[Tensor]],
    epochs: int,
    batches: int = 1,
    *,
    largest_gradient: float | None = None,
    rng: np.random.Generator | None = None,
    checkpoint: Checkpoint | None = None,
    quiet: bool = True,
) -> None:
    """Train a network in place; interrupted and begun again it gets the same weights as in one go.

    Args:
        optimiser: the learning rates of its groups are the peaks of the schedule.
        losses: the losses of the `batches` batches of an epoch, each computed when its turn comes.
        largest_gradient: norm to which gradients are clipped.
        rng: numpy's generator, where the losses draw from one.
        checkpoint: of another fit, it is ignored and written over; it holds the whole fit at the end.
        quiet: no progress bar.

    Raises:
        InputError: the checkpoint cannot be written.
    """
    torch.set_num_threads(1)  # these networks are small: a second thread only waits
    peaks = [float(group["lr"]) for group in optimiser.param_groups]
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, peaks, total_steps=epochs * batches)
    keeper = _Keeper(checkpoint, {"network": network, "optimiser": optimiser, "schedule": schedule}, rng)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), disable=quiet, transient=True) as progress:
        begin = keeper.restore()
        task = progress.add_task("training", total=epochs, completed=begin)
        for epoch in range(begin, epochs):
            for loss in losses(epoch):
                optimiser.zero_grad()
                torch.autograd.backward(loss)
                if largest_gradient is not None:
                    nn.utils.clip_grad_norm_(network.parameters(), largest_gradient)
                optimiser.step()
                schedule.step()
            progress.update(task, advance=1, description=f"training, loss {float(loss.detach()):.3f}, epoch")
            if (epoch + 1) % max(1, epochs // CHECKPOINTS) == 0:
                keeper.save(epoch + 1)
    keeper.save(epochs)
    network.eval()


def training_device() -> torch.device:
    """What networks are trained on: a GPU where there is one."""
    return torch.device("cuda" if torch.cuda.is_available() else "cpu")


def short_numbers() -> torch.autocast:
    """Inside, convolutions take 16-bit numbers (bfloat16), where what they run on has instructions for them.

    A processor that has none computes with them nine times as long as with 32-bit ones.
    """
    device = training_device().type
    has_them = torch.cpu._is_avx512_bf16_supported() or torch.cpu._is_amx_tile_supported() or device == "cuda"
    return torch.autocast(device, torch.bfloat16, enabled=has_them)


@dataclass(frozen=True, eq=False)
class Epoch(Dataset[dict[str, Tensor]]):
    """The batches of one epoch, each made when its turn comes: which ones follows from the seed alone.

    Attributes:
        rows: of each batch.
        make: a batch of its rows; it draws from a generator of its own.
        seed: of the epoch.
    """

    rows: Sequence[NDArray[np.int64]]
    make: Callable[[NDArray[np.int64], np.random.Generator], dict[str, Tensor]]
    seed: tuple[int, ...]

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, index: int) -> dict[str, Tensor]:
        return self.make(self.rows[index], np.random.default_rng([*self.seed, index]))

    def batches(self) -> Iterator[dict[str, Tensor]]:
        """All of them where the network is trained; a GPU is fed by several processes."""
        device = training_device()
        workers = FEEDERS if device.type == "cuda" else 0
        for batch in DataLoader(self, batch_size=None, num_workers=workers):
            yield {name: value.to(device) for name, value in batch.items()}


@dataclass(frozen=True)
class _Keeper:
    """Keeps all that a fit is made of in one file."""

    checkpoint: Checkpoint | None
    state: dict[str, _Stateful]
    rng: np.random.Generator | None

    def restore(self) -> int:
        """Epochs that are done already: none where there is no checkpoint, or one of another fit."""
        if self.checkpoint is None or not self.checkpoint.path.exists():
            return 0
        kept = torch.load(self.checkpoint.path, weights_only=True)
        if kept.get("fingerprint") != self.checkpoint.fingerprint:
            return 0
        for name, part in self.state.items():
            part.load_state_dict(kept[name])
        if self.rng is not None:
            self.rng.bit_generator.state = kept["numpy"]
        torch.set_rng_state(kept["torch"])
        return int(kept["epoch"])

    def save(self, epoch: int) -> None:
        if self.checkpoint is None:
            return
        kept = {name: part.state_dict() for name, part in self.state.items()} | {
            "fingerprint": self.checkpoint.fingerprint,
            "epoch": epoch,
            "numpy": None if self.rng is None else self.rng.bit_generator.state,
            "torch": torch.get_rng_state(),
        }
        written = io.BytesIO()
        torch.save(kept, written)
        write_whole(self.checkpoint.path, written.getvalue())
