"""Training of what tells who lies on whom, and how, at what a trained centre net sees in drawn trays. Imports torch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from bracket_cell.learned.inference.exposure import POOR, mean_level, spoiled
from bracket_cell.learned.inference.onnx_model import Inputs, Network
from bracket_cell.learned.parts.maps import INPUT_PX, PLANES, Peak, overlap, peaks
from bracket_cell.learned.parts.model import AXIS_PX, LEAST_SCORE
from bracket_cell.learned.parts.stacked import CROP_PX, STACKED_KIND, stack_crops
from bracket_cell.learned.records import UNKNOWN
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import Product
from bracket_ground.interfaces.resting_pose import lies_raised
from bracket_lab.learned.parts.augment import turned
from bracket_lab.learned.parts.data import Label, Scene
from bracket_lab.learned.parts.network import StackNet
from bracket_lab.learned.parts.settings import StackTraining
from bracket_lab.learned.training.recipe import Recipe, Task, on_examples
from bracket_lab.learned.training.still_dataset import data_hash
from bracket_lab.learned.training.training_loop import short_numbers

SAME_BOX = 0.5  # intersection over union, from which a peak is a label's
WORTH = 0.25  # of the right type, where two labels may be a peak's
SHOWN = 256  # crops that tell the range of every layer's 8-bit numbers


@dataclass(frozen=True, eq=False)
class Thing:
    """A thing as the centre net sees it, and what it really is.

    Attributes:
        kind: by the centre net.
        place_m, yaw_rad: where the centre net supposes it.
        on_top: whether it lies on another, though that may be hidden.
        carrying: whether another lies on it.
    """

    scene: Scene
    kind: int
    place_m: Array
    yaw_rad: float
    label: Label
    on_top: bool
    carrying: bool


@dataclass(frozen=True, eq=False)
class Sample:
    """A crop and what is to be said of it.

    Attributes:
        posed: whether the pose is to be told: it lies, and is of the type that the centre net says.
        wanted: (LYING,) axes and middle in the crop's frame.
        stacked: (2,) whether it lies on another, and whether another lies on it.
    """

    crop: NDArray[np.float32]
    kind: int
    posed: bool
    wanted: NDArray[np.float32]
    stacked: NDArray[np.float32]


def things_seen(scenes: Sequence[Scene], product: Product, floor_m: float, centre: Network) -> list[Thing]:
    """What the centre net sees in some images and is really there."""
    types, found = tuple(product.parts), []
    for scene in scenes:
        turn, image = turned(scene, None)
        planes = (image.transpose(2, 0, 1).astype(np.float32) / 255 - np.float32(0.5))[np.newaxis]
        maps = centre.run({"image": planes})
        carrying = {number for label in scene.labels for number in label.on}
        for peak in peaks(maps["heat"][0], maps["further"][0], LEAST_SCORE):
            number = _label_of(peak, scene, turn, types)
            if number is not None and scene.labels[number].pose is not None:
                place, yaw = _supposed(peak, scene, floor_m, len(types))
                label = scene.labels[number]
                on_top = _on_top(label, product, floor_m)
                found.append(Thing(scene, peak.kind, place, yaw, label, on_top, number in carrying))
    return found


def _on_top(label: Label, product: Product, floor_m: float) -> bool:
    kind = product.parts.get(label.part)
    hidden = kind is not None and label.pose is not None and lies_raised(kind, label.pose, floor_m)
    return bool(label.on) or hidden


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
    """Train the network and write it to `out`; interrupted, the same call goes on there."""
    things = things_seen(scenes, product, floor_m, centre)
    on_top, carrying = sum(thing.on_top for thing in things), sum(thing.carrying for thing in things)
    facts = {"things seen": float(len(things)), "on top": float(on_top), "carrying": float(carrying)}
    torch.manual_seed(seed)
    rng = np.random.default_rng([seed, 4])
    network = StackNet(len(product.parts), settings.widths, settings.hidden)
    network(torch.zeros(2, PLANES, *reversed(CROP_PX)))  # the lazy layer learns its width
    network.to(memory_format=torch.channels_last)
    alike = torch.tensor([kind.alike_after_half_turn for kind in product.parts.values()])

    def loss(some: list[Thing]) -> Tensor:
        return _loss(network, [stack_sample(thing, product, settings, rng) for thing in some], alike)

    task = Task(out=out, seed=seed, command=command, quiet=quiet)
    recipe = Recipe(
        kind=STACKED_KIND,
        network=network,
        settings=settings,
        vocabulary={"parts": tuple(product.parts)},
        data_sha256=data_hash(scenes),
        **on_examples(things, loss, settings, rng),
    )
    recipe.fit(task)
    shown = [stack_sample(thing, product, settings, rng).crop for thing in things[:: max(1, len(things) // SHOWN)]]
    samples: list[Inputs] = [{"crops": np.stack(shown[:count])} for count in (2, 1, 5)]
    met_with: list[Inputs] = [{"crops": crop[np.newaxis]} for crop in shown]
    outputs = ("lies", "stacked")
    return recipe.write(task, outputs, samples, lambda: facts, any_rows=True, tolerance=1e-4, met_with=met_with)


def stack_sample(thing: Thing, product: Product, settings: StackTraining, rng: np.random.Generator | None) -> Sample:
    """A crop, a little off and in other light; without a generator where the centre net supposes the thing."""
    place, yaw, scene = thing.place_m, thing.yaw_rad, thing.scene
    if rng is not None:
        place = place + rng.normal(0, settings.off_m, 3)
        yaw = yaw + rng.normal(0, settings.off_rad) + np.pi * (rng.random() < 0.5)
    crop = stack_crops(scene.image, scene.camera, scene.world_from_camera, [place], [yaw])[0]
    levels = np.rint((crop[:3].transpose(1, 2, 0) + 0.5) * 255).clip(0, 255).astype(np.uint8)
    if rng is not None:
        levels = spoiled(levels, rng, mean_level(scene.image), POOR)
    crop[:3] = levels.transpose(2, 0, 1).astype(np.float32) / 255 - np.float32(0.5)
    parts, pose = list(product.parts.items()), thing.label.pose
    assert pose is not None
    name, kind = parts[thing.kind] if thing.kind < len(parts) else (UNKNOWN, parts[0][1])
    seen = Pose.from_yaw((float(place[0]), float(place[1]), float(place[2])), float(yaw)).inverse()
    middle = seen.transform(pose.transform(np.array([0.0, 0.0, kind.size_m[2] / 2])))
    turn = seen.rotation @ pose.rotation
    wanted = np.concatenate([turn[:, 0], turn[:, 1], middle * 100]).astype(np.float32)
    posed = name == thing.label.part != UNKNOWN and thing.label.upright is False
    stacked = np.array([thing.on_top, thing.carrying], np.float32)
    return Sample(crop, min(thing.kind, len(parts) - 1), posed, wanted, stacked)


def _label_of(peak: Peak, scene: Scene, turn: Array, types: tuple[str, ...]) -> int | None:
    """Number of the label that a peak is of."""
    name = types[peak.kind] if peak.kind < len(types) else UNKNOWN
    scores = []
    for number, label in enumerate(scene.labels):
        outline = label.outline_px @ turn[:, :2].T + turn[:, 2]
        both = overlap(peak.box_px, np.concatenate([outline.min(axis=0), outline.max(axis=0)]))
        if both >= SAME_BOX:
            scores.append((both + WORTH * (label.part == name), number))
    return max(scores)[1] if scores else None


def _supposed(peak: Peak, scene: Scene, floor_m: float, types: int) -> tuple[Array, float]:
    """Where the detector supposes a thing that lies, by the true camera, and its heading."""
    height, width = scene.image.shape[:2]
    scale = np.array([width / INPUT_PX[0], height / INPUT_PX[1]])
    middle = (peak.centre_px + 0.5) * scale - 0.5
    way = AXIS_PX * np.array([np.cos(peak.axis_rad), np.sin(peak.axis_rad)])
    pixels = middle + np.stack([np.zeros(2), way, -way])
    known = peak.kind < types
    places = scene.camera.onto_plane(scene.world_from_camera, pixels, floor_m + max(peak.height_m, 0.0) * known)
    yaw = float(np.arctan2(*(places[1] - places[2])[1::-1])) if known else 0.0
    return places[0], yaw


def _loss(network: StackNet, samples: Sequence[Sample], alike: Tensor) -> Tensor:
    """L1 of the pose, where there is one: of a part that is alike after half a turn, to the nearer of both."""
    with short_numbers():
        seen = network.seen(torch.from_numpy(np.stack([sample.crop for sample in samples])))
    lies, stacked = network.tell(seen.float())
    kinds = torch.tensor([sample.kind for sample in samples])
    said, truth = (
        lies[torch.arange(len(kinds)), kinds],
        torch.from_numpy(np.stack([sample.wanted for sample in samples])),
    )
    off = (said[:, :6] - truth[:, :6]).abs().mean(dim=1)
    other = (said[:, :6] + truth[:, :6]).abs().mean(dim=1)
    turned_off = torch.where(alike[kinds], torch.minimum(off, other), off)
    away = nn.functional.smooth_l1_loss(said[:, 6:], truth[:, 6:], reduction="none", beta=0.1).mean(dim=1)
    posed = torch.tensor([float(sample.posed) for sample in samples])
    pose = ((2 * turned_off + 0.5 * away) * posed).sum() / posed.sum().clamp(min=1)
    wanted = torch.from_numpy(np.stack([sample.stacked for sample in samples]))
    return pose + 2 * nn.functional.binary_cross_entropy_with_logits(stacked, wanted)
