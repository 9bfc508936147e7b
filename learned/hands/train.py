"""Training of the small tracker's two networks. Imports torch: never at run time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional as F

from cell.interfaces.bench import CameraSetup
from cell.interfaces.errors import ModelError
from cell.interfaces.pose import Array
from cell.interfaces.product import Product
from learned.fitting import Checkpoint, fit
from learned.hands.augment import varied
from learned.hands.dataset import EDGE_PX, PATCH_PX, HandData, load_hands
from learned.hands.networks import FINDER_CELLS, HEAT_PX, Finder, Found, Read, Reader, split_facts
from learned.hands.regions import REGION_PX, planes
from learned.hands.slim import FINDER_KIND, READER_KIND, finder_file
from learned.hands.turns import drawn_turns, turned_images, turned_points
from learned.onnx_model import ModelCard, OnnxModel
from learned.torch_model import TorchModel, write_weights

EPOCHS = 10
FINDER_EPOCHS_SHARE = 0.5  # of the reader's epochs: it learns sooner
BATCH = 32
NO_HANDS_SHARE = 0.6  # as many places without a hand are read in an epoch, other ones each time
LEARNING_RATE, WEIGHT_DECAY = 3e-3, 1e-2
LARGEST_GRADIENT = 5.0
SHIFT_PX = (PATCH_PX - REGION_PX) // 2  # of a region about its hand, in training
SHIFT_OF_NONE = 0.3  # of that, about what is no hand: else it might show one in its middle
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
FINDER_NOISE = 0.03  # its images are made small, which averages noise
NOTHING_WEIGHT = 0.4  # of hands that hold nothing
TOLERANCE = 1e-3  # of scores, shares and metres: deep sums of 32-bit numbers differ by a few 1e-5
SCALED_SHARE, LARGEST_SCALE = 0.5, 1.2  # of hands that are made larger or smaller, and by how much
PALM_SPREAD = 0.1  # standard deviation of the logarithm of a palm's length, among people and not only in training
MIXED = 0.3  # of the colours: beyond it nobody could tell a part by its paint


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
    command: str = "cell train hands",
    quiet: bool = False,
) -> dict[str, float]:
    """Train both networks and write them, the reader to `out` and the finder beside it.

    Args:
        folders: of `cell data hands`.
        score: scores of the tracker that reads `out`.

    Returns:
        The scores.

    Raises:
        InputError: a folder cannot be used.
    """
    types = tuple(product.parts)
    training = Training(load_hands(folders, setup, types, seed), seed, epochs, quiet)
    card = ModelCard(
        kind=FINDER_KIND,
        config={
            "epochs": epochs,
            "batch": BATCH,
            "frames": len(training.data.small),
            "hands": int(_hands(training.data)),
            "palm_length_m": round(float(np.median(training.data.palm_lengths_m)), 4),
            "palm_spread": PALM_SPREAD,
        },
        vocabulary={"parts": types},
        data_sha256=training.data.sha256,
        command=command,
        seed=seed,
    )
    checkpoint = out.with_suffix(".checkpoint")
    if not (checkpoint.exists() and _is_made(finder_file(out), card)):  # else it goes on after the finder
        finder = fit_finder(training, out.with_suffix(".finder.checkpoint"))
        small = {"image": planes(training.data.small[:1])}
        write_weights(TorchModel(finder, Found._fields, card), finder_file(out), [small], dict, tolerance=TOLERANCE)
    reader = fit_reader(training, len(types), checkpoint)
    batch = reader_batch(training.data, np.arange(2), np.random.default_rng(seed))
    region = {name: batch[name].numpy() for name in ("region", "around", "place")}
    model = TorchModel(reader, Read._fields, card.model_copy(update={"kind": READER_KIND}))
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
            with torch.autocast("cpu", torch.bfloat16):
                logits = network.logits(images)
            yield finder_loss(logits.float(), *wanted)

    epochs = max(1, round(FINDER_EPOCHS_SHARE * training.epochs))
    _fit(network, losses, len(data.small), replace(training, epochs=epochs), rng, checkpoint)
    return network.to(memory_format=torch.contiguous_format)


def finder_targets(data: HandData, rows: NDArray[np.int64], turns: Array) -> tuple[NDArray[np.float32], ...]:
    """By frame and cell: score (n, 1, r, c), offset (n, 2, r, c), and weight (n, 1, r, c), 0 where nobody knows.

    Args:
        rows: (n,) frames, in order.
        turns: (n,) [rad] by which each is turned.
    """
    lines, columns = FINDER_CELLS
    score = np.zeros((len(rows), 1, lines, columns), np.float32)
    offset = np.full((len(rows), 2, lines, columns), 0.5, np.float32)
    weight = np.ones_like(score)
    line, column = np.mgrid[0:lines, 0:columns] + 0.5
    size_px, small_px = data.regions.size_px, np.array(data.small.shape[2:0:-1], np.float64)
    for hands, sure in ((data.unsure, False), (data.centres, True)):
        places = np.searchsorted(rows, hands[:, 0])
        chosen = np.flatnonzero(np.isin(hands[:, 0], rows))
        seen = turned_points(hands[chosen, 1:] - 0.5, turns[places[chosen]], small_px) + 0.5
        inside = (np.minimum(seen, 1 - seen) * size_px).min(axis=1) >= EDGE_PX
        for one, (x, y), shown in zip(places[chosen], seen, inside, strict=True):
            away = (column - x * columns) ** 2 + (line - y * lines) ** 2
            if not (sure and shown):
                weight[one, 0][away < 4] = 0
                continue
            cell = min(lines - 1, int(y * lines)), min(columns - 1, int(x * columns))
            score[one, 0] = np.maximum(score[one, 0], np.exp(-away / 1.5))
            score[one, 0][cell] = 1.0
            weight[one, 0][away < 4] = 1
            offset[(one, slice(None), *cell)] = x * columns - cell[1], y * lines - cell[0]
    return score, offset, weight


def finder_loss(logits: Tensor, score: Tensor, offset: Tensor, weight: Tensor) -> Tensor:
    """Focal loss of the scores, mean distance of the offsets, for each hand."""
    found = torch.sigmoid(logits[:, :1]).clamp(1e-4, 1 - 1e-4)
    hit = score == 1
    right = -((1 - found) ** FOCAL_EASY) * found.log()
    wrong = -((1 - score) ** FOCAL_NEAR) * found**FOCAL_EASY * (1 - found).log()
    away = (torch.sigmoid(logits[:, 1:]) - offset).abs().sum(dim=1, keepdim=True)
    total = (torch.where(hit, right + away, wrong) * weight).sum()
    return total / hit.sum().clamp(min=1)


def fit_reader(training: Training, types: int, checkpoint: Path | None = None) -> Reader:
    """Train the network that reads one hand."""
    torch.manual_seed(training.seed)
    rng = np.random.default_rng([training.seed, 7])
    data, network = training.data, Reader(types).to(memory_format=torch.channels_last)
    hands, empty = (np.flatnonzero(data.facts[:, 0] == value) for value in (1, 0))
    most = min(len(empty), round(NO_HANDS_SHARE * len(hands)))

    def losses(_: int) -> Iterator[Tensor]:
        chosen = np.concatenate([hands, rng.permutation(empty)[:most]])
        for rows in _batches(chosen, rng):
            yield reader_loss(network, reader_batch(data, rows, rng))

    _fit(network, losses, len(hands) + most, training, rng, checkpoint)
    return network.to(memory_format=torch.contiguous_format)


def reader_batch(data: HandData, rows: NDArray[np.int64], rng: np.random.Generator) -> dict[str, Tensor]:
    """Regions that do not quite sit on their hands, of other sizes, half of them mirrored; what is true of them."""
    shifts = np.clip(rng.normal(0.0, SHIFT_PX / 2.5, (len(rows), 2)), -SHIFT_PX, SHIFT_PX)
    shifts = (shifts * np.where(data.facts[rows, :1] > 0, 1.0, SHIFT_OF_NONE)).round()
    logs = rng.uniform(-1.0, 1.0, len(rows)) * (rng.random(len(rows)) < SCALED_SHARE) * np.log(LARGEST_SCALE)
    scales = np.exp(logs).astype(np.float32)
    seen = list(zip(rows, scales, shifts, strict=True))
    cuts = [_scaled(data.patches[row], scale, shift) for row, scale, shift in seen]
    around = [
        data.regions.around(data.small[data.frames[row]], data.centres_px[row], shift, float(scale))
        for row, scale, shift in seen
    ]
    places = [data.regions.place(data.centres_px[row]) for row in rows]
    moved = (shifts / REGION_PX).astype(np.float32)
    points, boxes = (shares - 0.5 for shares in (data.points[rows], data.boxes[rows]))
    arrays = {
        "region": planes(np.stack(cuts)),
        "around": planes(np.stack(around)),
        "points": (points - moved[:, np.newaxis]) * scales[:, np.newaxis, np.newaxis] + 0.5,
        "box": (boxes - np.tile(moved, 2)) * scales[:, np.newaxis] + 0.5,
        "facts": data.facts[rows],
        "heights": data.heights_m[rows],
        "angle": data.log_angles[rows] + logs.astype(np.float32),
        "held": data.held[rows],
        "place": np.array(places, np.float32),
    }
    batch: dict[str, Tensor] = {name: torch.from_numpy(np.ascontiguousarray(one)) for name, one in arrays.items()}
    batch["around"], _ = varied(batch["around"], rng, FINDER_NOISE, shades=False)
    batch["region"], mixed = varied(batch["region"], rng, shades=False)
    batch["paint"] = mixed < MIXED
    return mirrored(batch, torch.from_numpy(rng.random(len(rows)) < 0.5))


def _scaled(patch: NDArray[np.uint8], scale: float, shift_px: NDArray[np.float64]) -> NDArray[np.uint8]:
    """The region about the middle of a patch, shifted (right, down), and seen so much larger."""
    corner = (PATCH_PX - 1) / 2 + shift_px - (REGION_PX - 1) / 2 / scale
    back = np.array([[1 / scale, 0.0, corner[0]], [0.0, 1 / scale, corner[1]]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    cut = cv2.warpAffine(patch, back, (REGION_PX, REGION_PX), flags=flags, borderMode=cv2.BORDER_REPLICATE)
    return cut.astype(np.uint8, copy=False)


def mirrored(batch: dict[str, Tensor], chosen: Tensor) -> dict[str, Tensor]:
    """The chosen rows seen in a mirror: a left hand becomes a right one."""
    hand = chosen & (batch["facts"][:, 0] > 0)
    for name in ("region", "around"):
        batch[name] = torch.where(chosen[:, None, None, None], batch[name].flip(-1), batch[name])
    side = torch.tensor([1.0, 0.0])
    batch["points"] = torch.where(
        chosen[:, None, None], side - batch["points"] * torch.tensor([1.0, -1.0]), batch["points"]
    )
    left, top, right, bottom = batch["box"].unbind(dim=1)
    batch["box"] = torch.where(chosen[:, None], torch.stack([1 - right, top, 1 - left, bottom], dim=1), batch["box"])
    batch["place"] = torch.where(chosen[:, None], batch["place"] * torch.tensor([-1.0, 1.0]), batch["place"])
    batch["facts"][:, 1] = torch.where(hand, 1 - batch["facts"][:, 1], batch["facts"][:, 1])
    return batch


def reader_loss(network: Reader, batch: Mapping[str, Tensor]) -> Tensor:
    """The weighted sum of all losses; only presence where there is no hand."""
    with torch.autocast("cpu", torch.bfloat16):  # points and sizes need more digits than what is seen
        seen = network.maps(batch["region"], batch["around"])
    deep, fine, heat, around = (one.float() for one in seen)
    points, facts = network.tell(deep, fine, heat, around, batch["place"])
    told = split_facts(facts)
    hand = batch["facts"][:, 0] > 0
    known = ((batch["points"] > 0) & (batch["points"] < 1)).all(dim=2) & hand[:, None]
    wanted = torch.nan_to_num(batch["points"])
    likely = F.binary_cross_entropy_with_logits(told.likely, batch["facts"], reduction="none")
    typed = hand & batch["paint"]
    terms = {
        "points": _mean((points - wanted).abs().sum(dim=2), known),
        "heat": _mean(-(heat_target(wanted) * F.log_softmax(heat.flatten(2), dim=2)).sum(dim=2), known),
        "box": _mean((told.box - batch["box"].clamp(-0.2, 1.2)).abs().mean(dim=1), hand),
        "heights": _mean(_unlikely(told.heights_m - batch["heights"], told.height_errors_m).mean(dim=1), hand),
        "angle": _mean(_unlikely(told.log_angle - batch["angle"], told.angle_error), hand),
        "present": likely[:, 0].mean(),
        "side": _mean(likely[:, 1], hand),
        "acting": _mean(likely[:, 2], hand),
        "held": _mean(F.cross_entropy(told.held, batch["held"], reduction="none") * _rarity(batch["held"]), typed),
    }
    return torch.stack([WEIGHTS[name] * term for name, term in terms.items()]).sum()


def heat_target(points: Tensor) -> Tensor:
    """Normal distributions about points (n, k, 2), as (n, k, cells) that sum to 1."""
    middles = torch.arange(HEAT_PX) + 0.5
    away = ((points[..., None] * HEAT_PX - middles) / HEAT_SPREAD).pow(2)  # (n, k, 2, s)
    logits = -(away[:, :, 1, :, None] + away[:, :, 0, None, :]) / 2
    return torch.softmax(logits.flatten(2), dim=2)


def _unlikely(wrong: Tensor, error: Tensor) -> Tensor:
    """Minus the logarithm of the probability of being so wrong (Laplace), where the mean error is told."""
    return wrong.abs() / error + error.log()


def _rarity(held: Tensor) -> Tensor:
    """(n,) Weights: most hands hold nothing."""
    return torch.where(held == 0, NOTHING_WEIGHT, 1.0)


def _mean(values: Tensor, chosen: Tensor) -> Tensor:
    return (values * chosen).sum() / chosen.sum().clamp(min=1)


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


def _hands(data: HandData) -> float:
    return float(data.facts[:, 0].sum())
