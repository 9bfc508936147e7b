"""Training of the hole reader's network on labelled stills of the plate, and export to ONNX. Imports torch."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import Field
from torch import Tensor, nn

from bracket_cell.learned.holes.model import (
    CROP_PX,
    KIND,
    LEAST_EMPTY,
    LEAST_FILLED,
    LEAST_UPRIGHT,
    hole_crops,
    squares_m,
)
from bracket_cell.learned.inference.exposure import SOFT, levelled, mean_level, spoiled
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import Product
from bracket_lab.learned.holes.evaluate import Plate
from bracket_lab.learned.training.recipe import Recipe, Task, on_examples
from bracket_lab.learned.training.schedule import MOST_EPOCHS, Schedule
from bracket_lab.learned.training.still_dataset import data_hash, split


class HoleTraining(Schedule):
    """Training of the network that reads holes.

    Attributes:
        widths: channels at a half, a quarter and an eighth of the crop.
        hidden: width of the layer that all answers are read from.
        off_m, off_rad: standard deviations of the camera's calibration errors that it learns to live with.
        validation_share: of recordings, kept for the calibration of probabilities.
        most_called_empty: share of filled holes that may be called empty, from which the least probability follows.
        most_misnamed: share of holes that may be said to hold a part that they do not hold.
        astray_share: of parts that lie, lean or stand beside their hole, as they are met with. There are more of them
            in training data, and probabilities are chosen as if there were not.
    """

    widths: tuple[int, int, int] = (16, 32, 48)
    hidden: int = Field(default=64, ge=8, le=1024)
    off_m: float = Field(default=0.0015, ge=0, le=0.02)
    off_rad: float = Field(default=0.002, ge=0, le=0.1)
    epochs: int = Field(default=14, ge=1, le=MOST_EPOCHS)
    batch: int = Field(default=10, ge=1, le=256)  # images, each with all its holes
    peak_rate: float = Field(default=3e-3, gt=0, le=1)
    weight_decay: float = Field(default=3e-4, ge=0, le=1)
    validation_share: float = Field(default=0.15, gt=0, lt=1)
    most_called_empty: float = Field(default=0.0005, gt=0, le=0.1)
    most_misnamed: float = Field(default=0.004, gt=0, le=0.1)
    astray_share: float = Field(default=0.15, gt=0, lt=1)


def _conv(inside: int, out: int, stride: int) -> nn.Sequential:
    convolution = nn.Conv2d(inside, out, 3, stride, 1, bias=False)
    return nn.Sequential(convolution, nn.BatchNorm2d(out), nn.ReLU(inplace=True))


class HoleNet(nn.Module):
    """Crops of holes to what is in them, whether it is upright, and whether something covers it."""

    def __init__(self, types: int, widths: tuple[int, int, int], hidden: int) -> None:
        super().__init__()
        first, second, third = widths
        self.seen = nn.Sequential(
            _conv(3, first, 2),
            _conv(first, second, 2),
            _conv(second, second, 1),
            _conv(second, third, 2),
            _conv(third, third // 2, 1),
            nn.Flatten(),
        )
        self.hidden = nn.Sequential(nn.LazyLinear(hidden), nn.ReLU(inplace=True), nn.Dropout(0.2))
        self.kinds = nn.Linear(hidden, types + 1)
        self.others = nn.Linear(hidden, 2)

    def forward(self, crops: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Crops (n, 3, 48, 48) to logits: empty and types (n, types + 1), upright (n,), covered (n,)."""
        hidden = self.hidden(self.seen(crops))
        others = self.others(hidden)
        return self.kinds(hidden), others[:, 0], others[:, 1]


class HoleAnswer(nn.Module):
    """A network whose answers are probabilities, for export.

    Args:
        temperature: by which logits of kinds are divided (Guo, On Calibration of Modern Neural Networks, 2017).
    """

    def __init__(self, network: HoleNet, temperature: float) -> None:
        super().__init__()
        self.network, self.temperature = network, temperature

    def forward(self, crops: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """As `HoleNet.forward`, as probabilities."""
        kinds, upright, covered = self.network(crops)
        return torch.softmax(kinds / self.temperature, dim=1), torch.sigmoid(upright), torch.sigmoid(covered)


OUTPUTS = ("kinds", "upright", "covered")
COVERED, BARE = 0.15, 0.04  # share hidden from which a hole counts as covered, and up to which it does not
MARGIN_PX = 12  # around what is cut out, for blur
TEMPERATURES = np.geomspace(0.5, 4.0, 40)
MISSED_COST = 2.0  # of a part astray that is called upright, in upright ones that are called astray
LEAST_LEGAL, MOST_LEGAL = 0.5, 0.999  # below, something else may be likelier


def train_holes(
    plates: Sequence[Plate],
    bench: Bench,
    product: Product,
    out: Path,
    seed: int,
    settings: HoleTraining | None = None,
    *,
    command: str = "",
    quiet: bool = True,
) -> dict[str, float]:
    """Train, calibrate on recordings that were kept apart, and write the weights.

    Returns:
        Scores on those recordings, the same as on the model card.
    """
    settings, task = settings or HoleTraining(), Task(out=out, seed=seed, command=command, quiet=quiet)
    learned, kept = split(plates, settings.validation_share, seed)
    recipe = hole_recipe(learned, bench, product, seed, settings)
    recipe.fit(task)
    network = recipe.network
    logits, truth, bare, seated = _answers(network, kept, bench, product)
    temperature = _temperature(logits, truth)
    shares = torch.softmax(logits / temperature, dim=1).numpy()
    weights = as_met_with(truth.numpy(), seated.numpy(), settings.astray_share)
    least = least_sure(shares, truth.numpy(), bare.numpy(), weights, settings)
    straight = least_upright(plates, settings.astray_share)
    wanted = np.where(shares.argmax(axis=1) == 0, least[LEAST_EMPTY], least[LEAST_FILLED])
    said = (shares.max(axis=1) >= wanted)[bare]
    scores = validation_scores(said, (shares.argmax(axis=1) == truth.numpy())[bare])
    thresholds = {**least, LEAST_UPRIGHT: straight, "temperature": temperature}
    rng = np.random.default_rng(0)
    samples = [{"crops": rng.uniform(-0.5, 0.5, (n, 3, CROP_PX, CROP_PX)).astype(np.float32)} for n in (6, 1, 9)]
    written = replace(recipe, more=thresholds, data_sha256=data_hash(plates))
    return written.write(
        task, OUTPUTS, samples, lambda: scores, answer=HoleAnswer(cast(HoleNet, network), temperature), any_rows=True
    )


def validation_scores(said: NDArray[np.bool_], right: NDArray[np.bool_]) -> dict[str, float]:
    """Of bare holes (n,): the share that something is said of, and the share of these that is right, if there are any.

    After seconds of training nothing may be sure enough to be said.
    """
    scores = {"validation_said": float(said.mean()) if said.size else 0.0}
    return scores | ({"validation_right": float(right[said].mean())} if said.any() else {})


def as_met_with(truth: NDArray[np.int64], seated: NDArray[np.bool_], astray_share: float) -> Array:
    """Weights (n,) of holes under which as many of the filled ones hold a part that is astray as are met with."""
    filled = truth > 0
    own = float(np.mean(~seated[filled])) if filled.any() else 0.0
    if not 0 < own < 1:
        return np.ones(len(truth))
    return np.where(filled, np.where(seated, (1 - astray_share) / (1 - own), astray_share / own), 1.0)


def least_upright(plates: Sequence[Plate], astray_share: float) -> float:
    """The probability above which a part counts as upright.

    As few parts are astray as are met with, where training shows more of them; and one that is taken for upright costs
    more than a question about one that stands.
    """
    own = float(np.mean([not hole.upright for plate in plates for hole in plate.holes if hole.part] or [False]))
    if not 0 < own < 1:
        return 0.5
    met, shown = MISSED_COST * astray_share / (1 - astray_share), own / (1 - own)
    return met / (met + shown)


def least_sure(
    shares: NDArray[np.float32],
    truth: NDArray[np.int64],
    bare: NDArray[np.bool_],
    weights: Array,
    settings: HoleTraining,
) -> dict[str, float]:
    """The least probabilities at which no more holes than allowed are wrongly called empty, or filled with a type.

    What is called empty counts for every hole, what is misnamed for those that nothing hides: a part that is held over
    a hole looks like one that stands in it, however sure one is, and the network says by itself what is covered.

    Args:
        shares: (n, types + 1) probabilities, empty first.
        truth: (n,) right answers.
        bare: (n,) nothing hides them.
        weights: (n,) how often such holes are met with.
    """
    said, sure = shares.argmax(axis=1), shares.max(axis=1)
    empty, wrong = said == 0, said != truth

    def least(wrongly: NDArray[np.bool_], allowed: float) -> float:
        order = np.argsort(-sure[wrongly])
        too_many = np.cumsum(weights[wrongly][order]) > allowed
        wanted = float(sure[wrongly][order][np.argmax(too_many)]) + 1e-6 if too_many.any() else 0.0
        return min(max(wanted, LEAST_LEGAL), MOST_LEGAL)

    return {
        LEAST_EMPTY: least(empty & wrong, settings.most_called_empty * float(weights[truth > 0].sum())),
        LEAST_FILLED: least(~empty & wrong & bare, settings.most_misnamed * float(weights[bare].sum())),
    }


def hole_recipe(plates: Sequence[Plate], bench: Bench, product: Product, seed: int, settings: HoleTraining) -> Recipe:
    """The network that reads holes, untrained."""
    torch.manual_seed(seed)
    rng, types = np.random.default_rng([seed, 1]), tuple(product.parts)
    network = HoleNet(len(types), settings.widths, settings.hidden)
    network(torch.zeros(2, 3, CROP_PX, CROP_PX))  # the lazy layer learns its width
    squares = squares_m(bench, product)

    def loss(chosen: list[Plate]) -> Tensor:
        return _loss(network, chosen, squares, types, settings, rng)

    return Recipe(
        kind=KIND,
        network=network,
        settings=settings,
        vocabulary={"parts": types},
        data_sha256=data_hash(plates),
        **on_examples(plates, loss, settings, rng),
    )


def _loss(
    network: HoleNet,
    plates: Sequence[Plate],
    squares: Array,
    types: tuple[str, ...],
    settings: HoleTraining,
    rng: np.random.Generator,
) -> Tensor:
    crops = np.concatenate([_seen(plate, squares, settings, rng) for plate in plates])
    truth, upright, covered = _truth(plates, types)
    kinds, up, hidden = network(torch.from_numpy(crops))
    bare = 1 - covered
    filled = (truth > 0).float() * bare
    named = nn.functional.cross_entropy(kinds, truth, reduction="none") * bare
    stands = nn.functional.binary_cross_entropy_with_logits(up, upright, reduction="none") * filled
    clear = ((covered >= COVERED) | (covered <= BARE)).float()
    hides = nn.functional.binary_cross_entropy_with_logits(hidden, (covered >= COVERED).float(), reduction="none")
    total: Tensor = named.mean() + 0.5 * stands.mean() + (hides * clear).mean()
    return total


def _seen(plate: Plate, squares: Array, settings: HoleTraining, rng: np.random.Generator) -> NDArray[np.float32]:
    """Crops in another light, by a camera that is believed a little elsewhere than it is; mirrored or not."""
    x, y, z = rng.normal(0, settings.off_m, 3)
    a, b, c = (float(value) for value in rng.normal(0, settings.off_rad / 2, 3))
    turn = math.sqrt(max(0.0, 1 - a * a - b * b - c * c)), a, b, c
    believed = plate.world_from_camera @ Pose((float(x), float(y), float(z)), turn)
    pixels = plate.camera.project(believed, squares.reshape(-1, 3))
    left, top = np.clip(np.floor(pixels.min(axis=0)).astype(int) - MARGIN_PX, 0, None)
    right, bottom = np.ceil(pixels.max(axis=0)).astype(int) + MARGIN_PX
    image = plate.image.copy()
    image[top:bottom, left:right] = spoiled(image[top:bottom, left:right], rng, mean_level(plate.image), SOFT)
    crops = hole_crops(image, plate.camera, believed, squares)
    return np.ascontiguousarray(crops[..., ::-1] if rng.random() < 0.5 else crops, np.float32)


def _truth(plates: Sequence[Plate], types: tuple[str, ...]) -> tuple[Tensor, Tensor, Tensor]:
    """Index of what is in each hole (0: nothing), whether it is upright, and share hidden; all (n,)."""
    holes = [hole for plate in plates for hole in plate.holes]
    kinds = torch.tensor([0 if hole.part is None else 1 + types.index(hole.part) for hole in holes])
    return kinds, torch.tensor([float(hole.upright) for hole in holes]), torch.tensor([hole.covered for hole in holes])


def _answers(
    network: nn.Module, plates: Sequence[Plate], bench: Bench, product: Product
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Of the holes that the network does not call covered: logits, truth, nothing hides them, the part is seated."""
    squares, types = squares_m(bench, product), tuple(product.parts)
    logits, truths, bare, seated = [], [], [], []
    with torch.no_grad():
        for plate in plates:
            crops = hole_crops(levelled(plate.image), plate.camera, plate.world_from_camera, squares)
            kinds, _, hidden = network(torch.from_numpy(crops))
            logits.append(kinds[hidden < 0])
            kinds, upright, covered = (values[hidden < 0] for values in _truth([plate], types))
            truths.append(kinds)
            bare.append(covered <= BARE)
            seated.append(upright > 0.5)
    return torch.cat(logits), torch.cat(truths), torch.cat(bare), torch.cat(seated)


def _temperature(logits: Tensor, truth: Tensor) -> float:
    """The one under which the truth is likeliest."""
    losses = [float(nn.functional.cross_entropy(logits / float(temperature), truth)) for temperature in TEMPERATURES]
    return float(TEMPERATURES[int(np.argmin(losses))])
