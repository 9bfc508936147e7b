"""Training of the small tracker's three networks. Imports torch: never at run time."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from cell.errors import ModelError
from cell.interfaces.bench import CameraSetup
from cell.interfaces.product import Product
from learned.hands.augment import drawn_turns, turned_images, varied
from learned.hands.data import HandData, load_hands
from learned.hands.examples import FINDER_NOISE, finder_targets, reader_batch, refiner_batch
from learned.hands.losses import finder_loss, reader_loss, refiner_loss
from learned.hands.model import FINDER_KIND, READER_KIND, REFINER_KIND, finder_file, refiner_file
from learned.hands.network import Finder, Found, Read, Reader
from learned.hands.refiner import Refined, Refiner
from learned.hands.regions import planes
from learned.inference.onnx_model import ModelCard, OnnxModel
from learned.training.torch_model import TorchModel, write_weights
from learned.training.training_loop import Checkpoint, fit, short_numbers

EPOCHS = 10
FINDER_EPOCHS_SHARE = 1.0  # of the reader's epochs
REFINER_EPOCHS_SHARE = 2.85  # and the refiner later: it is to be exact
BATCH = 32
NO_HANDS_SHARE = 0.6  # as many places without a hand are read in an epoch, other ones each time
LEARNING_RATE, WEIGHT_DECAY = 3e-3, 1e-2
LARGEST_GRADIENT = 5.0
TOLERANCE = 1e-3  # of scores, shares and metres: deep sums of 32-bit numbers differ by a few 1e-5
PALM_SPREAD = 0.1  # standard deviation of the logarithm of a palm's length, among people and not only in training


@dataclass(frozen=True)
class Training:
    """What is trained on, and how long."""

    data: HandData
    seed: int
    epochs: int = EPOCHS
    quiet: bool = False


def train_hands(
    folders: Sequence[Path],
    setup: CameraSetup,
    product: Product,
    out: Path,
    seed: int,
    *,
    score: Callable[[], dict[str, float]],
    epochs: int = EPOCHS,
    command: str = "cell lab train hands",
    apart: Collection[str] = (),
    quiet: bool = False,
) -> dict[str, float]:
    """Train the networks and write them, the reader to `out`, finder and refiner beside it.

    Args:
        folders: of `cell lab data hands`.
        score: scores of the tracker that reads `out`.
        apart: recordings that are not learned from.

    Returns:
        The scores.

    Raises:
        InputError: a folder cannot be used.
    """
    types = tuple(product.parts)
    training = Training(load_hands(folders, setup, types, seed, apart), seed, epochs, quiet)
    card = ModelCard(
        kind=FINDER_KIND,
        config={
            "epochs": epochs,
            "batch": BATCH,
            "frames": len(training.data.small),
            "hands": len(_rows_of_hands(training.data)),
            "palm_length_m": round(float(np.median(training.data.palm_lengths_m)), 4),
            "palm_spread": PALM_SPREAD,
        },
        vocabulary={"parts": types},
        data_sha256=training.data.sha256,
        command=command,
        seed=seed,
    )
    reading = card.model_copy(update={"kind": READER_KIND})
    begun = not _is_made(out, reading)  # interrupted, it goes on after what is made; the reader is the last
    if not (begun and _is_made(finder_file(out), card)):
        finder = fit_finder(training, out.with_suffix(".finder.checkpoint"))
        small = {"image": planes(training.data.small[:1])}
        write_weights(TorchModel(finder, Found._fields, card), finder_file(out), [small], dict, tolerance=TOLERANCE)
    closer = card.model_copy(update={"kind": REFINER_KIND})
    if not (begun and _is_made(refiner_file(out), closer)):
        refiner = fit_refiner(training, out.with_suffix(".refiner.checkpoint"))
        few = refiner_batch(training.data, _rows_of_sizes(training.data)[:2], np.random.default_rng(seed))
        closeups = {name: few[name].numpy() for name in ("closeup", "place")}
        model = TorchModel(refiner, Refined._fields, closer)
        write_weights(model, refiner_file(out), [closeups], dict, any_rows=True, tolerance=TOLERANCE, short=True)
    reader = fit_reader(training, len(types), out.with_suffix(".checkpoint"))
    batch = reader_batch(training.data, np.arange(2), np.random.default_rng(seed))
    region = {name: batch[name].numpy() for name in ("region", "around", "place")}
    model = TorchModel(reader, Read._fields, reading)
    return write_weights(model, out, [region], score, any_rows=True, tolerance=TOLERANCE)


def _is_made(path: Path, wanted: ModelCard) -> bool:
    """Whether a file holds what this very training made."""
    if not path.exists():
        return False
    try:
        card = OnnxModel.load(path, wanted.kind).card
    except ModelError:
        return False
    return (card.command, card.seed, card.config, card.data_sha256) == (
        wanted.command,
        wanted.seed,
        wanted.config,
        wanted.data_sha256,
    )


def fit_finder(training: Training, checkpoint: Path | None = None) -> Finder:
    """Train the network that finds hands in whole images."""
    torch.manual_seed(training.seed)
    rng = np.random.default_rng([training.seed, 6])
    data, network = training.data, Finder().to(memory_format=torch.channels_last)

    def losses(_: int) -> Iterator[Tensor]:
        for rows in _batches(np.arange(len(data.small)), rng):
            flip = rng.random() < 0.5
            turns = drawn_turns(len(rows), rng)
            small = planes(turned_images(data.small[rows], turns))
            images, _mixed = varied(torch.from_numpy(small), rng, FINDER_NOISE)
            wanted = [torch.from_numpy(one) for one in finder_targets(data, rows, turns)]
            if flip:
                images, wanted = images.flip(-1), [one.flip(-1) for one in wanted]
                wanted[1][:, 0] = 1 - wanted[1][:, 0]
            with short_numbers():
                logits = network.logits(images)
            yield finder_loss(logits.float(), *wanted)

    epochs = max(1, round(FINDER_EPOCHS_SHARE * training.epochs))
    _fit(network, losses, len(data.small), replace(training, epochs=epochs), rng, checkpoint)
    return network.to(memory_format=torch.contiguous_format)


def fit_reader(training: Training, types: int, checkpoint: Path | None = None) -> Reader:
    """Train the network that reads one hand."""
    torch.manual_seed(training.seed)
    rng = np.random.default_rng([training.seed, 7])
    data, network = training.data, Reader(types).to(memory_format=torch.channels_last)
    hands, empty = _rows_of_hands(data), np.flatnonzero(data.facts[:, 0] == 0)
    most = min(len(empty), round(NO_HANDS_SHARE * len(hands)))

    def losses(_: int) -> Iterator[Tensor]:
        chosen = np.concatenate([hands, rng.permutation(empty)[:most]])
        for rows in _batches(chosen, rng):
            yield reader_loss(network, reader_batch(data, rows, rng))

    _fit(network, losses, len(hands) + most, training, rng, checkpoint)
    return network.to(memory_format=torch.contiguous_format)


def fit_refiner(training: Training, checkpoint: Path | None = None) -> Refiner:
    """Train the network that looks at one hand once more."""
    torch.manual_seed(training.seed)
    rng = np.random.default_rng([training.seed, 8])
    data, network = training.data, Refiner().to(memory_format=torch.channels_last)
    hands = _rows_of_sizes(data)

    def losses(_: int) -> Iterator[Tensor]:
        for rows in _batches(hands, rng):
            yield refiner_loss(network, refiner_batch(data, rows, rng))

    epochs = round(REFINER_EPOCHS_SHARE * training.epochs)
    _fit(network, losses, len(hands), replace(training, epochs=epochs), rng, checkpoint)
    return network.to(memory_format=torch.contiguous_format)


def _fit(
    network: nn.Module,
    losses: Callable[[int], Iterator[Tensor]],
    rows: int,
    training: Training,
    rng: np.random.Generator,
    checkpoint: Path | None,
) -> None:
    optimiser = torch.optim.AdamW(network.parameters(), lr=LEARNING_RATE, weight_decay=WEIGHT_DECAY)
    identity = f"{type(network).__name__} {training.data.sha256} {training.seed} {training.epochs}"
    fit(
        network,
        optimiser,
        losses,
        training.epochs,
        len(range(0, rows - BATCH + 1, BATCH)),
        largest_gradient=LARGEST_GRADIENT,
        rng=rng,
        checkpoint=None if checkpoint is None else Checkpoint(checkpoint, identity),
        quiet=training.quiet,
    )


def _batches(rows: NDArray[np.int64], rng: np.random.Generator) -> Iterator[NDArray[np.int64]]:
    """Whole batches in a new order."""
    order = rng.permutation(rows)
    for start in range(0, len(rows) - BATCH + 1, BATCH):
        yield np.sort(order[start : start + BATCH])


def _rows_of_hands(data: HandData) -> NDArray[np.int64]:
    """Rows of the reader's arrays that show a hand."""
    return np.flatnonzero(data.facts[:, 0] == 1)


def _rows_of_sizes(data: HandData) -> NDArray[np.int64]:
    """Those of them whose hands have a known size."""
    return np.flatnonzero((data.facts[:, 0] == 1) & ~np.isnan(data.log_angles))
