"""Training of the small tracker's three networks. Imports torch: never at run time."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional as F

from bracket_cell.learned.hands.model import FINDER_KIND, READER_KIND, REFINER_KIND, finder_file, refiner_file
from bracket_cell.learned.hands.regions import planes
from bracket_cell.learned.inference.onnx_model import ModelCard, OnnxModel, digest_of
from bracket_ground.errors import InputError, ModelError
from bracket_ground.files.model import Model
from bracket_ground.interfaces.bench import CameraSetup
from bracket_ground.interfaces.product import Product
from bracket_lab.learned.hands.data import HandData, load_hands
from bracket_lab.learned.hands.examples import finder_batch, reader_batch, refiner_batch
from bracket_lab.learned.hands.network import HEAT_PX, Finder, Found, Read, Reader, split_facts
from bracket_lab.learned.hands.refiner import Maps, Refined, Refiner
from bracket_lab.learned.training.recipe import Recipe, Task
from bracket_lab.learned.training.torch_model import begin_with
from bracket_lab.learned.training.training_loop import Epoch, short_numbers, training_device

HEAT_SPREAD = 1.0  # cells, of the target of a heatmap
FOCAL_NEAR, FOCAL_EASY = 4, 2  # powers of the focal loss of CornerNet (Law 2018)
WEIGHTS = {
    "points": 10.0,
    "heat": 0.1,
    "box": 2.0,
    "heights": 0.2,
    "angle": 0.2,
    "present": 1.0,
    "side": 0.5,
    "acting": 0.5,
    "held": 1.0,
}
NOTHING_WEIGHT = 0.4  # of hands that hold nothing


def finder_loss(network: Finder, batch: Mapping[str, Tensor]) -> Tensor:
    """Focal loss of the scores, mean distance of the offsets, for each hand."""
    with short_numbers():
        seen = network.logits(batch["image"])
    logits, score, offset, weight = seen.float(), batch["score"], batch["offset"], batch["weight"]
    found = torch.sigmoid(logits[:, :1]).clamp(1e-4, 1 - 1e-4)
    hit = score == 1
    right = -((1 - found) ** FOCAL_EASY) * found.log()
    wrong = -((1 - score) ** FOCAL_NEAR) * found**FOCAL_EASY * (1 - found).log()
    away = (torch.sigmoid(logits[:, 1:]) - offset).abs().sum(dim=1, keepdim=True)
    total = (torch.where(hit, right + away, wrong) * weight).sum()
    return total / hit.sum().clamp(min=1)


def reader_loss(network: Reader, batch: Mapping[str, Tensor]) -> Tensor:
    """The weighted sum of all losses; only presence where there is no hand."""
    with short_numbers():  # points and sizes need more digits than what is seen
        seen = network.maps(batch["region"], batch["around"])
    deep, fine, heat, around = (layer.float() for layer in seen)
    points, facts = network.tell(deep, fine, heat, around, batch["place"])
    split = split_facts(facts)
    hand = batch["facts"][:, 0] > 0
    known = ((batch["points"] > 0) & (batch["points"] < 1)).all(dim=2) & hand[:, None]
    wanted = torch.nan_to_num(batch["points"])
    likely = F.binary_cross_entropy_with_logits(split.likely, torch.nan_to_num(batch["facts"]), reduction="none")
    typed = hand & batch["paint"] & (batch["held"] >= 0)
    sized, raised = hand & ~batch["angle"].isnan(), hand & ~batch["heights"].isnan().any(dim=1)
    sided = hand & ~batch["facts"][:, 1].isnan()
    batch = {**batch, **{name: torch.nan_to_num(batch[name]) for name in ("angle", "heights")}}
    held = batch["held"].clamp(min=0)
    terms = {
        "points": _mean((points - wanted).abs().sum(dim=2), known),
        "heat": _mean(-(heat_target(wanted) * F.log_softmax(heat.flatten(2), dim=2)).sum(dim=2), known),
        "box": _mean((split.box - batch["box"].clamp(-0.2, 1.2)).abs().mean(dim=1), hand),
        "heights": _mean(unlikely(split.heights_m - batch["heights"], split.height_errors_m).mean(dim=1), raised),
        "angle": _mean(unlikely(split.log_angle - batch["angle"], split.angle_error), sized),
        "present": likely[:, 0].mean(),
        "side": _mean(likely[:, 1], sided),
        "acting": _mean(likely[:, 2], hand),
        "held": _mean(F.cross_entropy(split.held, held, reduction="none") * _rarity(held), typed),
    }
    return torch.stack([WEIGHTS[name] * term for name, term in terms.items()]).sum()


def refiner_loss(network: Refiner, batch: Mapping[str, Tensor]) -> Tensor:
    """The weighted sum of the losses of points, heatmaps and size."""
    with short_numbers():  # points and sizes need more digits than what is seen
        seen = network.maps(batch["closeup"])
    maps = Maps(*(layer.float() for layer in seen))
    answers = network.tell(maps, batch["place"])
    wanted = torch.nan_to_num(batch["points"])
    known = ((batch["points"] > 0) & (batch["points"] < 1)).all(dim=2)
    target = heat_target(wanted, maps.heat.shape[-1])
    terms = {
        "points": _mean((answers.points - wanted).abs().sum(dim=2), known),
        "heat": _mean(-(target * F.log_softmax(maps.heat.flatten(2), dim=2)).sum(dim=2), known),
        "angle": unlikely(answers.log_ratio - batch["ratio"], answers.error).mean(),
    }
    return torch.stack([WEIGHTS[name] * term for name, term in terms.items()]).sum()


def heat_target(points: Tensor, side: int = HEAT_PX) -> Tensor:
    """Normal distributions about points (n, k, 2), as (n, k, cells) that sum to 1."""
    middles = torch.arange(side, device=points.device) + 0.5
    away = ((points[..., None] * side - middles) / HEAT_SPREAD).pow(2)  # (n, k, 2, s)
    logits = -(away[:, :, 1, :, None] + away[:, :, 0, None, :]) / 2
    return torch.softmax(logits.flatten(2), dim=2)


def unlikely(wrong: Tensor, error: Tensor) -> Tensor:
    """Minus the logarithm of the probability of being so wrong (Laplace), where the mean error is told."""
    return wrong.abs() / error + error.log()


def _rarity(held: Tensor) -> Tensor:
    """(n,) Weights: most hands hold nothing."""
    return torch.where(held == 0, NOTHING_WEIGHT, 1.0)


def _mean(values: Tensor, chosen: Tensor) -> Tensor:
    return (values * chosen).sum() / chosen.sum().clamp(min=1)


Network = TypeVar("Network", bound=nn.Module)

EPOCHS = 10
FINDER_EPOCHS_SHARE = 1.0  # of the reader's epochs
REFINER_EPOCHS_SHARE = 2.85  # and the refiner later: it is to be exact
BATCH = 32
NO_HANDS_SHARE = 0.6  # as many places without a hand are read in an epoch, other ones each time
LEARNING_RATE, TUNING_RATE, WEIGHT_DECAY = 3e-3, 6e-4, 1e-2  # TUNING_RATE: of weights that were learned before
TOLERANCE = 1e-3  # of scores, shares and metres: deep sums of 32-bit numbers differ by a few 1e-5
PALM_SPREAD = 0.1  # standard deviation of the logarithm of a palm's length, among people and not only in training


@dataclass(frozen=True)
class Training:
    """What is trained on, and how long.

    Attributes:
        begin: weights of a reader, with finder and refiner beside it, to begin with; None for random ones.
    """

    data: HandData
    types: tuple[str, ...]
    seed: int
    epochs: int = EPOCHS
    begin: Path | None = None


class HandTraining(Model):
    """What the cards say of it."""

    epochs: int
    batch: int = BATCH


def train_hands(
    folders: Sequence[Path],
    setup: CameraSetup,
    product: Product,
    out: Path,
    seed: int,
    *,
    score: Callable[[], dict[str, float]],
    epochs: int = EPOCHS,
    begin: Path | None = None,
    command: str = "cell lab train hands",
    apart: Collection[str] = (),
    quiet: bool = False,
) -> dict[str, float]:
    """Train the networks and write them, the reader to `out`, finder and refiner beside it.

    Args:
        folders: of `cell lab data hands`.
        score: scores of the tracker that reads `out`.
        apart: origins of frames that are not learned from.
        begin: weights to begin with, finder and refiner beside them.

    Returns:
        The scores.

    Raises:
        InputError: a folder cannot be used.
    """
    types = tuple(product.parts)
    training = Training(load_hands(folders, setup, types, seed, apart), types, seed, epochs, begin)
    data, rng = training.data, partial(np.random.default_rng, seed)
    if len(_rows_of_sizes(data)) < BATCH:  # before minutes go into the finder
        raise InputError("hands: heights are learned from hands whose size is known: add --simulated")
    reading, finding, refining = (
        Task(out=path, seed=seed, command=command, quiet=quiet) for path in (out, finder_file(out), refiner_file(out))
    )
    begun = not _is_made(out, reader_recipe(training).card(reading))  # interrupted, it goes on after what is made
    finder = finder_recipe(training)
    if not (begun and _is_made(finder_file(out), finder.card(finding))):
        finder.fit(finding)
        finder.write(finding, Found._fields, [{"image": planes(data.small[:1])}], dict, tolerance=TOLERANCE)
    refiner = refiner_recipe(training)
    if not (begun and _is_made(refiner_file(out), refiner.card(refining))):
        refiner.fit(refining)
        few = refiner_batch(data, _rows_of_sizes(data)[:2], rng())
        seen = {name: few[name].numpy() for name in ("closeup", "place")}
        refiner.write(refining, Refined._fields, [seen], dict, any_rows=True, tolerance=TOLERANCE, short=True)
    reader = reader_recipe(training)
    reader.fit(reading)
    batch = reader_batch(data, np.arange(2), rng())
    region = {name: batch[name].numpy() for name in ("region", "around", "place")}
    return reader.write(reading, Read._fields, [region], score, any_rows=True, tolerance=TOLERANCE)


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


def finder_recipe(training: Training) -> Recipe:
    """The network that finds hands in whole images."""
    torch.manual_seed(training.seed)
    data, network = training.data, Finder().to(memory_format=torch.channels_last)
    epochs = max(1, round(FINDER_EPOCHS_SHARE * training.epochs))
    rows = np.arange(len(data.small))
    return _recipe(FINDER_KIND, training, network, epochs, finder_loss, finder_batch, lambda rng: rng.permutation(rows))


def reader_recipe(training: Training) -> Recipe:
    """The network that reads one hand."""
    torch.manual_seed(training.seed)
    data, network = training.data, Reader(len(training.types)).to(memory_format=torch.channels_last)
    hands, empty = _rows_of_hands(data), np.flatnonzero(data.facts[:, 0] == 0)
    most = min(len(empty), round(NO_HANDS_SHARE * len(hands)))

    def drawn(rng: np.random.Generator) -> NDArray[np.int64]:
        return rng.permutation(np.concatenate([hands, rng.permutation(empty)[:most]]))

    return _recipe(READER_KIND, training, network, training.epochs, reader_loss, reader_batch, drawn)


def refiner_recipe(training: Training) -> Recipe:
    """The network that looks at one hand once more."""
    torch.manual_seed(training.seed)
    network = Refiner().to(memory_format=torch.channels_last)
    hands, epochs = _rows_of_sizes(training.data), round(REFINER_EPOCHS_SHARE * training.epochs)
    drawn = lambda rng: rng.permutation(hands)  # noqa: E731
    return _recipe(REFINER_KIND, training, network, epochs, refiner_loss, refiner_batch, drawn)


def _recipe(
    kind: str,
    training: Training,
    network: Network,
    epochs: int,
    loss: Callable[[Network, Mapping[str, Tensor]], Tensor],
    batch: Callable[[HandData, NDArray[np.int64], np.random.Generator], dict[str, Tensor]],
    drawn: Callable[[np.random.Generator], NDArray[np.int64]],
) -> Recipe:
    """One of the three.

    Args:
        batch: of rows of the data.
        drawn: the rows of an epoch in their order.
    """
    data, which, begin = training.data, zlib.crc32(kind.encode()), training.begin
    if begin is not None:
        files = {FINDER_KIND: finder_file(begin), READER_KIND: begin, REFINER_KIND: refiner_file(begin)}
        begin_with(network, files[kind], kind)
    rows = len(drawn(np.random.default_rng(0)))
    if (batches := len(range(0, rows - BATCH + 1, BATCH))) == 0:
        raise InputError(f"{kind}: {rows} examples are too few to learn from; {BATCH} are needed, or --simulated")

    def losses(epoch: int) -> Iterator[Tensor]:
        seed = training.seed, which, epoch
        order = drawn(np.random.default_rng(seed))
        chosen = [np.sort(order[start : start + BATCH]) for start in range(0, batches * BATCH, BATCH)]
        for inputs in Epoch(chosen, partial(batch, data), seed).batches():
            yield loss(network, inputs)

    return Recipe(
        kind=kind,
        network=network,
        losses=losses,
        epochs=epochs,
        batches=batches,
        device=training_device(),
        rate=LEARNING_RATE if begin is None else TUNING_RATE,
        decay=WEIGHT_DECAY,
        settings=HandTraining(epochs=training.epochs),
        vocabulary={"parts": training.types},
        data_sha256=data.sha256,
        more={
            "frames": len(data.small),
            "hands": len(_rows_of_hands(data)),
            "palm_length_m": round(float(np.median(data.palm_lengths_m)), 4),
            "palm_spread": PALM_SPREAD,
            **({"photographs": {**data.photographs}} if data.photographs else {}),
            **({} if begin is None else {"began_with": digest_of(begin.read_bytes())[:16]}),
        },
    )


def _rows_of_hands(data: HandData) -> NDArray[np.int64]:
    """Rows of the reader's arrays that show a hand."""
    return np.flatnonzero(data.facts[:, 0] == 1)


def _rows_of_sizes(data: HandData) -> NDArray[np.int64]:
    """Those of them whose hands have a known size."""
    return np.flatnonzero((data.facts[:, 0] == 1) & ~np.isnan(data.log_angles))
