"""Training of the part detector's two networks on labelled images of trays, and export to ONNX. Imports torch."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from bracket_cell.learned.inference.exposure import POOR, mean_level, spoiled
from bracket_cell.learned.inference.onnx_model import Inputs
from bracket_cell.learned.parts.maps import CROP_PX, HEIGHT, INPUT_PX, PLANES, UPRIGHT, crop_of
from bracket_cell.learned.parts.model import CENTRE_KIND, POSE_KIND, POSES, pose_file
from bracket_cell.learned.records import UNKNOWN
from bracket_ground.interfaces.product import Product
from bracket_lab.learned.parts.augment import SCALES, sample
from bracket_lab.learned.parts.data import Label, Scene
from bracket_lab.learned.parts.network import CentreAnswer, CentreNet, PoseNet, TaughtCentreNet
from bracket_lab.learned.parts.settings import CentreTraining, PoseTraining
from bracket_lab.learned.training.recipe import Recipe, Task, checkpoint_of, on_examples
from bracket_lab.learned.training.still_dataset import data_hash
from bracket_lab.learned.training.training_loop import short_numbers

CENTRE_OUTPUTS, POSE_OUTPUTS = ("heat", "further", "features"), ("corrections", "kinds")
CENTIMETRE = 100.0
TOLERANCE = 1e-3  # of logits and features: deep sums of 32-bit numbers differ by a few 1e-5
LEAST_AXIS_PX = 1.0  # an axis that is seen shorter points at the camera
TAUGHT_RATE = 1e-3  # peak of the learning rate of a network that knows pictures
PHOTOGRAPHS = (0.7, 1.4)  # scales by which training images differ, as nobody knows how far away they were taken
SHOWN = 64  # scenes that tell the range of every layer's 8-bit numbers
WRONG_WAY_SHARE = 0.3  # of parts whose ends differ, seen the wrong way round


def centre_loss(answer: tuple[Tensor, Tensor, Tensor], heat: Tensor, further: Tensor, weights: Tensor) -> Tensor:
    """Penalty-reduced focal loss of the heat (Zhou 2019, Eq. 1), L1 of what stands at middles."""
    logits, said, _ = answer
    probability = torch.sigmoid(logits).clamp(1e-4, 1 - 1e-4)
    middle = (heat > 0.999).float()
    count = middle.sum().clamp(min=1.0)
    found = -((1 - probability) ** 2) * probability.log() * middle
    false = -((1 - heat) ** 4) * probability**2 * (1 - probability).log() * (1 - middle)
    total: Tensor = (found.sum() + false.sum()) / count
    unsure = nn.functional.binary_cross_entropy_with_logits(said[:, UPRIGHT], further[:, UPRIGHT], reduction="none")
    off = (said - further).abs()
    scale = weights[:, 0].sum().clamp(min=1.0)
    lengths = (off * weights)[:, : HEIGHT + 1].sum() / scale
    return total + lengths + (unsure * weights[:, UPRIGHT]).sum() / scale


def centre_recipe(
    scenes: Sequence[Scene], product: Product, floor_m: float, seed: int, settings: CentreTraining
) -> Recipe:
    """The centre net, untrained, but where no pose is known: pictures of a person's own are few."""
    torch.manual_seed(seed)
    rng, types, poses = np.random.default_rng([seed, 1]), tuple(product.parts), bool(posed_things(scenes))
    plain = CentreNet(len(types), settings.widths, settings.features) if poses else None
    network = (plain or TaughtCentreNet(len(types), settings.features)).to(memory_format=torch.channels_last)
    settings = settings if poses else settings.model_copy(update={"peak_rate": TAUGHT_RATE})

    def loss(chosen: list[Scene]) -> Tensor:
        samples = [sample(scene, types, floor_m, rng, SCALES if poses else PHOTOGRAPHS) for scene in chosen]
        image, heat, further, weights = (
            torch.from_numpy(np.stack([getattr(row, name) for row in samples]))
            for name in ("image", "heat", "further", "weights")
        )
        with short_numbers():
            logits, said, features = network(image)
        return centre_loss((logits.float(), said.float(), features), heat, further, weights)

    return Recipe(
        kind=CENTRE_KIND,
        network=network,
        settings=settings,
        vocabulary={"parts": types},
        data_sha256=data_hash(scenes),
        stays=True,
        more={POSES: poses},
        **on_examples(scenes, loss, settings, rng),
    )


def pose_recipe(scenes: Sequence[Scene], product: Product, floor_m: float, seed: int, settings: PoseTraining) -> Recipe:
    """The pose net, untrained."""
    torch.manual_seed(seed)
    rng, types = np.random.default_rng([seed, 2]), tuple(product.parts)
    network = PoseNet(len(types), settings.widths, settings.hidden)
    network(torch.zeros(2, PLANES, *reversed(CROP_PX)))  # the lazy layer learns its width
    network.to(memory_format=torch.channels_last)

    def loss(chosen: list[tuple[Scene, Label]]) -> Tensor:
        return _pose_loss(network, [pose_sample(thing, product, floor_m, settings, rng) for thing in chosen])

    return Recipe(
        kind=POSE_KIND,
        network=network,
        settings=settings,
        vocabulary={"parts": types},
        data_sha256=data_hash(scenes),
        **on_examples(posed_things(scenes), loss, settings, rng),
    )


def posed_things(scenes: Sequence[Scene]) -> list[tuple[Scene, Label]]:
    """Things whose poses are known: a pose net learns from no others."""
    return [(scene, label) for scene in scenes for label in scene.labels if label.pose is not None]


PoseSample = tuple[NDArray[np.float32], int, NDArray[np.float32]]


def pose_sample(
    thing: tuple[Scene, Label], product: Product, floor_m: float, settings: PoseTraining, rng: np.random.Generator
) -> PoseSample:
    """A crop around where the centre net might see a thing, the type of a standing part, and how far off it is."""
    (scene, label), types = thing, tuple(product.parts)
    assert label.pose is not None
    stands = label.part != UNKNOWN and bool(label.upright)
    name = label.part if label.part != UNKNOWN else types[int(rng.integers(len(types)))]
    kind = product.parts[name]
    middle_m = floor_m + kind.peg_length_m + kind.size_m[2] / 2
    x, y = label.pose.position_m[:2]
    yaw = label.pose.yaw_rad
    if not stands:  # as the detector would look at it: by its middle, and along its axis where it has one
        ends = label.centre_px + np.array([[0.0], [1.0], [-1.0]]) * label.axis_px
        (x, y, _), ahead, behind = scene.camera.onto_plane(scene.world_from_camera, ends, middle_m)
        along = float(np.linalg.norm(label.axis_px)) > LEAST_AXIS_PX
        yaw = np.arctan2(*(ahead - behind)[1::-1]) if along else rng.uniform(-np.pi, np.pi)
    off, off_rad = rng.normal(0, settings.off_m, 2), rng.normal(0, settings.off_rad)
    turned = yaw + off_rad
    if kind.alike_after_half_turn:
        turned += np.pi * (rng.random() < 0.5)
    elif rng.random() < WRONG_WAY_SHARE:
        turned, stands = turned + np.pi, False
    cosine, sine = np.cos(turned), np.sin(turned)
    place = np.array([x + off[0] * cosine - off[1] * sine, y + off[0] * sine + off[1] * cosine, middle_m])
    crop = crop_of(scene.image, scene.camera, scene.world_from_camera, place, turned)
    levels = np.rint((crop[:3].transpose(1, 2, 0) + 0.5) * 255).clip(0, 255).astype(np.uint8)
    levels = spoiled(levels, rng, mean_level(scene.image), POOR)
    crop[:3] = levels.transpose(2, 0, 1).astype(np.float32) / 255 - 0.5
    wanted = np.array([-off[0] * CENTIMETRE, -off[1] * CENTIMETRE, -off_rad], np.float32)
    return crop, types.index(name) if stands else len(types), wanted


def _pose_loss(network: PoseNet, samples: Sequence[PoseSample]) -> Tensor:
    crops, kinds, wanted = zip(*samples, strict=True)
    truth = torch.tensor(kinds)
    with short_numbers():
        seen = network.seen(torch.from_numpy(np.stack(crops)))
    corrections, logits = network.tell(seen.float())
    types = corrections.shape[1]
    stands = truth < types
    own = corrections[torch.arange(len(truth)), truth.clamp(max=types - 1)]
    off = nn.functional.smooth_l1_loss(own, torch.from_numpy(np.stack(wanted)), reduction="none", beta=0.05)
    scale = torch.tensor([1.0, 1.0, 3.0])
    weight = stands.float()[:, None] * scale
    position = (off * weight).sum() / stands.sum().clamp(min=1)
    total: Tensor = 2 * position + 0.5 * nn.functional.cross_entropy(logits, truth)
    return total


def seen_by_centre(scenes: Sequence[Scene], product: Product, floor_m: float) -> list[Inputs]:
    """The images of some scenes, each as the centre net takes it."""
    types = tuple(product.parts)
    return [{"image": sample(scene, types, floor_m, None).image[np.newaxis]} for scene in scenes]


def seen_by_pose(scenes: Sequence[Scene], product: Product, floor_m: float, settings: PoseTraining) -> list[Inputs]:
    """Crops of all things in some scenes, as the pose net learns from them."""
    rng = np.random.default_rng(0)
    return [
        {"crops": pose_sample(thing, product, floor_m, settings, rng)[0][np.newaxis]} for thing in posed_things(scenes)
    ]


def train_parts(
    scenes: Sequence[Scene],
    product: Product,
    floor_m: float,
    out: Path,
    seed: int,
    *,
    epochs: int | None = None,
    command: str = "",
    quiet: bool = True,
) -> dict[str, float]:
    """Train both networks, and write the centre net to `out` and the pose net beside it.

    Boxes teach no poses: where none is known, there is no pose net, and nothing that is seen can be grasped.

    Returns:
        What was learned from; `cell lab eval parts` scores detectors, as that takes images.
    """
    centre, pose = CentreTraining(), PoseTraining()
    if epochs is not None:
        centre, pose = CentreTraining(epochs=epochs), PoseTraining(epochs=epochs)
    facts = {"images": float(len(scenes)), "things": float(sum(len(scene.labels) for scene in scenes))}
    shown, rng, poses = scenes[:: max(1, len(scenes) // SHOWN)], np.random.default_rng(0), posed_things(scenes)
    task = Task(out=out, seed=seed, command=command, quiet=quiet)
    first = centre_recipe(scenes, product, floor_m, seed, centre)
    first.fit(task)
    images = [{"image": rng.uniform(-0.5, 0.5, (1, 3, *reversed(INPUT_PX))).astype(np.float32)} for _ in range(2)]
    answer = CentreAnswer(cast(CentreNet, first.network))
    met_with = seen_by_centre(shown, product, floor_m) if poses else ()
    first.write(task, CENTRE_OUTPUTS, images, lambda: facts, answer=answer, met_with=met_with, tolerance=TOLERANCE)
    beside = task.beside(pose_file(out))
    if poses:
        second, rng = pose_recipe(scenes, product, floor_m, seed, pose), np.random.default_rng(0)
        second.fit(beside)
        shapes = [(count, PLANES, *reversed(CROP_PX)) for count in (2, 1, 5)]
        crops = [{"crops": rng.uniform(-0.5, 0.5, shape).astype(np.float32)} for shape in shapes]
        seen = seen_by_pose(shown, product, floor_m, pose)
        second.write(beside, POSE_OUTPUTS, crops, lambda: facts, any_rows=True, met_with=seen)
    checkpoint_of(out).unlink(missing_ok=True)
    return facts
