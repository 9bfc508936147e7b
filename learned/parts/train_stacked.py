"""Training of what tells who lies on whom, and how, on what a trained centre net sees of drawn trays. Imports torch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from cell.interfaces.pose import Array, Pose
from cell.interfaces.product import Product
from learned.inference.exposure import POOR, mean_level, spoiled
from learned.inference.onnx_model import Inputs, ModelCard, Network
from learned.parts.augment import turned
from learned.parts.data import UNKNOWN, Scene
from learned.parts.maps import INPUT_PX, PLANES, Maps, Peak, crops_of, overlap, peaks
from learned.parts.model import AXIS_PX, LEAST_SCORE, pose_file
from learned.parts.network import LyingNet, PairNet
from learned.parts.settings import StackTraining
from learned.parts.stacked import LYING_KIND, LYING_PX, LYING_STEP_M, PAIRS_KIND, near_pairs, pair_features
from learned.training.still_dataset import data_hash
from learned.training.torch_model import TorchModel, write_weights
from learned.training.training_loop import Checkpoint, fit_examples

TURNS = 3  # further images of each scene, turned at random, for the pairs
SAME_BOX = 0.5  # intersection over union, from which a peak is a label's
SHOWN = 256  # crops that tell the range of every layer's 8-bit numbers
WORTH = 0.25  # of the right type, where two labels may be a peak's


@dataclass(frozen=True)
class Lying:
    """A part that lies, as the centre net sees it.

    Attributes:
        place_m, yaw_rad: where the centre net supposes it.
    """

    scene: Scene
    kind: int
    place_m: Array
    yaw_rad: float
    world_from_part: Pose


Pair = tuple[NDArray[np.float32], float]


def examples(
    scenes: Sequence[Scene], product: Product, floor_m: float, centre: Network, seed: int, turns: int = TURNS
) -> tuple[list[Pair], list[Lying]]:
    """Pairs of peaks with whether the first lies on the second, by contact or by way of others; and what lies."""
    rng, types = np.random.default_rng([seed, 3]), tuple(product.parts)
    pairs: list[Pair] = []
    lying: list[Lying] = []
    for scene in scenes:
        for number in range(turns + 1):
            turn, image = turned(scene, None if number == 0 else rng)
            planes = (image.transpose(2, 0, 1).astype(np.float32) / 255 - np.float32(0.5))[np.newaxis]
            maps = centre.run({"image": planes})
            found, features = peaks(maps["heat"][0], maps["further"][0], LEAST_SCORE), maps["features"][0]
            labels = _labels_of(found, scene, turn, types)
            pairs += _pairs(found, features, labels, scene, len(types))
            if number == 0:
                lying += _lying(found, labels, scene, types, floor_m)
    return pairs, lying


def train_stacked(
    scenes: Sequence[Scene],
    product: Product,
    floor_m: float,
    centre: Network,
    out: Path,
    seed: int,
    settings: StackTraining,
    *,
    command: str = "",
    quiet: bool = True,
) -> dict[str, float]:
    """Train both networks, and write that of the pairs to `out` and the pose net of what lies beside it."""
    pairs, lying = examples(scenes, product, floor_m, centre, seed)
    facts = {"pairs": float(len(pairs)), "on top": sum(on for _, on in pairs), "lying": float(len(lying))}
    torch.manual_seed(seed)
    of_pairs = PairNet(len(pairs[0][0]), settings.hidden)
    of_lying = LyingNet(len(product.parts), settings.widths)
    of_lying(torch.zeros(2, PLANES, *reversed(LYING_PX)))  # the lazy layer learns its width
    rng, identity = np.random.default_rng([seed, 4]), f"{data_hash(scenes)} {settings.model_dump_json()} {seed}"
    kept = [Checkpoint(path.with_name(path.name + ".checkpoint"), identity) for path in (out, pose_file(out))]
    fit_examples(
        of_pairs, pairs, lambda some: _pair_loss(of_pairs, some), settings, rng, checkpoint=kept[0], quiet=quiet
    )
    of_pose = settings.model_copy(update={"epochs": settings.pose_epochs})

    def loss(some: list[Lying]) -> Tensor:
        return _lying_loss(of_lying, [lying_sample(one, product, settings, rng) for one in some], product)

    fit_examples(of_lying, lying, loss, of_pose, rng, checkpoint=kept[1], quiet=quiet)

    def card(kind: str) -> ModelCard:
        told = settings.model_dump(mode="json")
        words = {"parts": tuple(product.parts)}
        return ModelCard(
            kind=kind, config=told, vocabulary=words, data_sha256=data_hash(scenes), scores=facts,
            command=command or "train_stacked", seed=seed,
        )  # fmt: skip

    rows: list[Inputs] = [{"pairs": np.stack([one for one, _ in pairs[:count]])} for count in (2, 1, 5)]
    write_weights(TorchModel(of_pairs.eval(), ("logits",), card(PAIRS_KIND)), out, rows, lambda: dict(facts),
                  any_rows=True, tolerance=1e-4)  # fmt: skip
    shown = [lying_sample(one, product, settings, rng)[0] for one in lying[:: max(1, len(lying) // SHOWN)]]
    crops: list[Inputs] = [{"crops": one[np.newaxis]} for one in shown]
    some: list[Inputs] = [{"crops": np.stack(shown[:count])} for count in (2, 1, 5)]
    write_weights(TorchModel(of_lying.eval(), ("lies",), card(LYING_KIND)), pose_file(out), some, lambda: dict(facts),
                  any_rows=True, tolerance=1e-4, met_with=crops)  # fmt: skip
    return facts


def lying_sample(
    one: Lying, product: Product, settings: StackTraining, rng: np.random.Generator | None
) -> tuple[NDArray[np.float32], int, NDArray[np.float32]]:
    """A crop, the type, and what is to be said of it (LYING,): axes and middle in the crop's frame."""
    place, yaw, scene = one.place_m, one.yaw_rad, one.scene
    if rng is not None:
        place = place + rng.normal(0, settings.off_m, 3)
        yaw = yaw + rng.normal(0, settings.off_rad) + np.pi * (rng.random() < 0.5)
    where = scene.camera, scene.world_from_camera, [place], [yaw]
    crop = crops_of(scene.image, *where, size_px=LYING_PX, step_m=LYING_STEP_M)[0]
    if rng is not None:
        levels = np.rint((crop[:3].transpose(1, 2, 0) + 0.5) * 255).clip(0, 255).astype(np.uint8)
        levels = spoiled(levels, rng, mean_level(scene.image), POOR)
        crop[:3] = levels.transpose(2, 0, 1).astype(np.float32) / 255 - np.float32(0.5)
    kind = list(product.parts.values())[one.kind]
    seen = Pose.from_yaw((float(place[0]), float(place[1]), float(place[2])), float(yaw)).inverse()
    middle = seen.transform(one.world_from_part.transform(np.array([0.0, 0.0, kind.size_m[2] / 2])))
    turn = seen.rotation @ one.world_from_part.rotation
    wanted = np.concatenate([turn[:, 0], turn[:, 1], middle * 100]).astype(np.float32)
    return crop, one.kind, wanted


def _labels_of(found: Sequence[Peak], scene: Scene, turn: Array, types: tuple[str, ...]) -> list[int | None]:
    """Number of the label of each peak."""
    boxes = []
    for label in scene.labels:
        outline = label.outline_px @ turn[:, :2].T + turn[:, 2]
        boxes.append(np.concatenate([outline.min(axis=0), outline.max(axis=0)]))
    numbers: list[int | None] = []
    for peak in found:
        name = types[peak.kind] if peak.kind < len(types) else UNKNOWN
        scores = [
            (both + WORTH * (label.part == name), number)
            for number, (label, box) in enumerate(zip(scene.labels, boxes, strict=True))
            if (both := overlap(peak.box_px, box)) >= SAME_BOX
        ]
        numbers.append(max(scores)[1] if scores else None)
    return numbers


def _pairs(found: Sequence[Peak], features: Maps, labels: Sequence[int | None], scene: Scene, types: int) -> list[Pair]:
    near = near_pairs(found)
    if not len(near):
        return []
    below = _below(scene)
    rows = pair_features(found, near, features, types)
    told = []
    for (b, a), row in zip(near.tolist(), rows, strict=True):
        first, second = labels[b], labels[a]
        told.append((row, float(first is not None and second is not None and second in below[first])))
    return told


def _below(scene: Scene) -> list[set[int]]:
    """For each label those that it rests on, by way of others, too."""
    below = [set(label.on) for label in scene.labels]
    for _ in below:
        for own in below:
            for one in tuple(own):
                own |= below[one]
    return below


def _lying(
    found: Sequence[Peak], labels: Sequence[int | None], scene: Scene, types: tuple[str, ...], floor_m: float
) -> list[Lying]:
    height, width = scene.image.shape[:2]
    scale = np.array([width / INPUT_PX[0], height / INPUT_PX[1]])
    told = []
    for peak, number in zip(found, labels, strict=True):
        if number is None or peak.kind >= len(types) or scene.labels[number].upright:
            continue
        label = scene.labels[number]
        if label.part != types[peak.kind]:
            continue
        middle = (peak.centre_px + 0.5) * scale - 0.5
        way = AXIS_PX * np.array([np.cos(peak.axis_rad), np.sin(peak.axis_rad)])
        pixels = middle + np.stack([np.zeros(2), way, -way])
        place_m = floor_m + max(peak.height_m, 0.0)
        place, ahead, behind = scene.camera.onto_plane(scene.world_from_camera, pixels, place_m)
        yaw = float(np.arctan2(*(ahead - behind)[1::-1]))
        told.append(Lying(scene, peak.kind, place, yaw, label.pose))
    return told


def _pair_loss(network: PairNet, some: Sequence[Pair]) -> Tensor:
    rows, on = zip(*some, strict=True)
    logits = network(torch.from_numpy(np.stack(rows)))
    return nn.functional.binary_cross_entropy_with_logits(logits, torch.tensor(on))


def _lying_loss(network: LyingNet, samples: Sequence[tuple[NDArray[np.float32], int, NDArray[np.float32]]],
                product: Product) -> Tensor:  # fmt: skip
    """L1; of a part that is alike after half a turn, to the nearer of both."""
    crops, kinds, wanted = zip(*samples, strict=True)
    said = network(torch.from_numpy(np.stack(crops)))[torch.arange(len(kinds)), torch.tensor(kinds)]
    truth = torch.from_numpy(np.stack(wanted))
    alike = torch.tensor([kind.alike_after_half_turn for kind in product.parts.values()])[torch.tensor(kinds)]
    off = (said[:, :6] - truth[:, :6]).abs().mean(dim=1)
    other = (said[:, :6] + truth[:, :6]).abs().mean(dim=1)
    turned_off = torch.where(alike, torch.minimum(off, other), off)
    away = nn.functional.smooth_l1_loss(said[:, 6:], truth[:, 6:], reduction="none", beta=0.1).mean(dim=1)
    return (2 * turned_off + 0.5 * away).mean()


def turn_off_rad(one: Pose, other: Pose, *, alike: bool) -> float:
    """Angle between two poses; of a part that is alike after half a turn the lesser one."""
    half = np.diag([-1.0, -1.0, 1.0])
    turns = [one.rotation.T @ other.rotation, half @ one.rotation.T @ other.rotation]
    angles = [float(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1))) for turn in turns]
    return min(angles) if alike else angles[0]
