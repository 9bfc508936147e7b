"""Faster R-CNN as the paper has it (ResNet-101 with a feature pyramid), and smaller ones. Imports torch.

Trained from scratch, as no weights are fetched: batches are normalised, and nothing is frozen. Boxes pool their
features from the finest level alone, where a feature pyramid puts all that is under 112 pixels (Lin 2017, Eq. 1).
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torchvision.models.detection import FasterRCNN
from torchvision.models.detection.anchor_utils import AnchorGenerator
from torchvision.models.detection.backbone_utils import BackboneWithFPN, resnet_fpn_backbone
from torchvision.models.detection.faster_rcnn import FastRCNNPredictor, TwoMLPHead
from torchvision.models.detection.image_list import ImageList
from torchvision.models.detection.rpn import concat_box_prediction_layers
from torchvision.models.resnet import BasicBlock
from torchvision.ops import MultiScaleRoIAlign, box_iou, clip_boxes_to_image, remove_small_boxes

from bracket_cell.learned.inference.exposure import POOR, levelled, spoiled
from bracket_cell.learned.inference.onnx_model import Inputs
from bracket_cell.learned.parts.maps import INPUT_PX, network_input
from bracket_cell.learned.records import UNKNOWN
from bracket_ground.interfaces.product import Product
from bracket_lab.learned.parts.boxes import HEAD_KIND, KIND, REGIONS, head_file
from bracket_lab.learned.parts.data import Scene
from bracket_lab.learned.parts.evaluate import LEAST_SHOWN
from bracket_lab.learned.parts.settings import NARROW, RcnnTraining
from bracket_lab.learned.training.recipe import Recipe, Task
from bracket_lab.learned.training.still_dataset import data_hash
from bracket_lab.learned.training.torch_model import Answers, TorchModel
from bracket_lab.learned.training.training_loop import training_device

ANCHORS_PX, RATIOS = ((32,), (64,), (128,), (256,), (512,)), (0.5, 1.0, 2.0)  # as the paper and torchvision
FINEST = "0"  # level of the pyramid
POOLED = 7  # side of a box's features
RESNET18, PYRAMID, HIDDEN = (64, 128, 256, 512), 256, 1024  # channels of its stages; of the levels; of the head
LEARNED_REGIONS = {"rpn_pre_nms_top_n_train": 500, "rpn_post_nms_top_n_train": 200, "box_batch_size_per_image": 64}
ROUNDS = 20  # of a training, after each of which it can be interrupted
SHOWN = 48  # scenes that tell the range of every layer's 8-bit numbers
TOLERANCE = 0.01  # of scores, of features by their largest, and of 1 - IoU of the boxes that are used
USED = 0.05  # share of a class from which its box is one: torchvision's box_score_thresh
OUTPUTS, HEAD_OUTPUTS = ("scores", "boxes", "features"), ("shares", "boxes")


def rcnn(backbone: str, types: int, share: float = 1.0) -> FasterRCNN:
    """An untrained network for so many types and unknown things.

    Args:
        share: of the channels of ResNet-18, of its pyramid and of the head; 1 for the others.
    """
    width, height = INPUT_PX
    if backbone == NARROW:
        body: Any = _narrow_resnet18(share)
    else:
        body = resnet_fpn_backbone(backbone_name=backbone, weights=None, norm_layer=nn.BatchNorm2d, trainable_layers=5)
    hidden = _part(HIDDEN, share)
    return FasterRCNN(
        body,
        min_size=height,
        max_size=width,
        rpn_anchor_generator=AnchorGenerator(ANCHORS_PX, (RATIOS,) * len(ANCHORS_PX)),
        box_roi_pool=MultiScaleRoIAlign([FINEST], POOLED, 2),
        box_head=TwoMLPHead(body.out_channels * POOLED**2, hidden),
        box_predictor=FastRCNNPredictor(hidden, types + 2),  # the background is the first
        **LEARNED_REGIONS,
    )


def _narrow_resnet18(share: float) -> BackboneWithFPN:
    """ResNet-18 and its pyramid with a share of their channels."""
    widths = [_part(channels, share) for channels in RESNET18]
    layers: OrderedDict[str, nn.Module] = OrderedDict()
    stem = nn.Conv2d(3, widths[0], 7, 2, 3, bias=False), nn.BatchNorm2d(widths[0]), nn.ReLU(), nn.MaxPool2d(3, 2, 1)
    layers["stem"], before = nn.Sequential(*stem), widths[0]
    for number, width in enumerate(widths):
        stride = 1 if number == 0 else 2
        down = None
        if number:
            down = nn.Sequential(nn.Conv2d(before, width, 1, stride, bias=False), nn.BatchNorm2d(width))
        layers[str(number)] = nn.Sequential(BasicBlock(before, width, stride, down), BasicBlock(width, width))
        before = width
    levels = {str(number): str(number) for number in range(len(widths))}
    return BackboneWithFPN(nn.Sequential(layers), levels, widths, _part(PYRAMID, share))


def _part(channels: int, share: float) -> int:
    return max(8, round(channels * share))


def train_rcnn(
    scenes: Sequence[Scene], product: Product, out: Path, settings: RcnnTraining, task: Task
) -> dict[str, float]:
    """Train the network and write both stages, each compared with torch and then made to compute with 8-bit numbers.

    Interrupted and begun again it goes on from its checkpoint.

    Returns:
        What was learned from; `cell lab eval parts` scores detectors, as that takes images.

    Raises:
        InputError: a file cannot be written.
    """
    torch.manual_seed(task.seed)
    rng, types = np.random.default_rng([task.seed, 4]), tuple(product.parts)
    network = rcnn(settings.backbone, len(types), settings.share)
    network.train()
    rounds = max(1, min(ROUNDS, settings.steps))
    batches = max(1, settings.steps // rounds)

    def losses(_: int) -> Iterator[Tensor]:
        for _ in range(batches):
            chosen = [scenes[int(index)] for index in rng.integers(len(scenes), size=settings.batch)]
            yield sum(network(*_batch(chosen, types, rng)).values())

    recipe = Recipe(
        kind=KIND,
        network=network,
        losses=losses,
        epochs=rounds,
        batches=batches,
        rate=settings.peak_rate,
        decay=settings.weight_decay,
        settings=settings,
        vocabulary={"parts": types},
        data_sha256=data_hash(scenes),
        rng=rng,
        gradient=10.0,
        device=training_device(),
    )
    recipe.fit(task)
    return _write(recipe, out, scenes, task)


def _write(recipe: Recipe, out: Path, scenes: Sequence[Scene], task: Task) -> dict[str, float]:
    """Both stages as ONNX."""
    facts = {"images": float(len(scenes)), "things": float(sum(len(scene.labels) for scene in scenes))}
    shown = scenes[:: max(1, len(scenes) // SHOWN)]
    images: list[Inputs] = [{"image": network_input(levelled(scene.image))} for scene in shown]
    regions, head = Regions(recipe.network).eval(), Head(recipe.network)
    first, seen = TorchModel(regions, OUTPUTS, recipe.card(task)), list[Inputs]()
    for image in images:
        found = first.run(image)
        surest = np.argsort(-found["scores"])[:REGIONS]
        seen.append({"features": found["features"], "regions": found["boxes"][surest]})
    second, beside = replace(recipe, kind=HEAD_KIND), task.beside(head_file(out))
    how: dict[str, Any] = {"tolerance": TOLERANCE, "differences": differences}
    second.write(beside, HEAD_OUTPUTS, seen[:2], lambda: facts, answer=head, met_with=seen, **how)
    recipe.write(task, OUTPUTS, images[:2], lambda: facts, answer=regions, met_with=images, **how)
    return facts


def differences(found: Answers, expected: Answers) -> Iterator[tuple[str, float]]:
    """How far two answers of a stage are apart in what is used of them.

    Of boxes those of the surest regions, or of classes that are probable, each with its best match, inside the image:
    rounding alone changes a box far beyond it by many pixels, and equal scores may be ranked differently.
    """
    shares = "shares" if "shares" in expected else "scores"
    for one, other in ((found, expected), (expected, found)):
        used, beside = _boxes_used(one, shares, 1.0), _boxes_used(other, shares, 0.5)
        if len(used):
            overlap = box_iou(used, beside).max(dim=1).values if len(beside) else torch.zeros(1)
            yield "boxes", float(1 - overlap.min())
    ranked = (np.sort(scores[shares], axis=0)[::-1][:REGIONS] for scores in (found, expected))
    yield shares, float(np.abs(np.subtract(*ranked)).max())
    if "features" in expected:
        most = float(np.abs(expected["features"]).max())
        yield "features", float(np.abs(found["features"] - expected["features"]).max()) / max(most, 1e-6)


def _boxes_used(answers: Answers, shares: str, limit: float) -> Tensor:
    """(n, 4) of the surest regions, or of the classes of regions that are probable, as far as they are in the image.

    Args:
        limit: more boxes the lower it is, so that one at the edge of what is used has its match.
    """
    boxes, rank = answers["boxes"], answers[shares]
    if rank.ndim == 1:
        used = boxes[np.argsort(-rank, kind="stable")[: int(REGIONS / limit)]]
    else:
        used = boxes[:, 1:][rank[:, 1:] >= USED * limit]
    inside: Tensor = clip_boxes_to_image(torch.from_numpy(np.array(used)).reshape(-1, 4), INPUT_PX[::-1])
    return inside[remove_small_boxes(inside, 1.0)]


def _batch(
    scenes: Sequence[Scene], types: tuple[str, ...], rng: np.random.Generator
) -> tuple[list[Tensor], list[dict[str, Tensor]]]:
    """Images and targets, each mirrored by chance."""
    images, wanted, width, device = [], [], INPUT_PX[0], training_device()
    for scene in scenes:
        image = torch.from_numpy(network_input(spoiled(scene.image, rng, camera=POOR))[0] + 0.5)
        target = targets(scene, types)
        if rng.random() < 0.5:
            image = image.flip(2)
            target["boxes"][:, [0, 2]] = width - target["boxes"][:, [2, 0]]
        if rng.random() < 0.5:
            image = image.flip(1)
            target["boxes"][:, [1, 3]] = INPUT_PX[1] - target["boxes"][:, [3, 1]]
        images.append(image.to(device))
        wanted.append({name: value.to(device) for name, value in target.items()})
    return images, wanted


def targets(scene: Scene, types: tuple[str, ...]) -> dict[str, Tensor]:
    """Boxes (n, 4) of whole things, what hides them included, and their classes (n,), in the network's input."""
    height, width = scene.image.shape[:2]
    scale = np.tile([INPUT_PX[0] / width, INPUT_PX[1] / height], 2)
    labels = [label for label in scene.labels if label.shown >= LEAST_SHOWN]
    boxes = np.array([label.box_px * scale for label in labels], np.float32).reshape(-1, 4)
    kinds = [len(types) + 1 if label.part == UNKNOWN else types.index(label.part) + 1 for label in labels]
    return {"boxes": torch.from_numpy(boxes), "labels": torch.tensor(kinds, dtype=torch.int64)}


class Regions(nn.Module):
    """The first stage, for export: image (1, 3, 240, 320) to scores (n,), boxes (n, 4) and the finest features."""

    mean: Tensor
    deviation: Tensor
    anchors: Tensor

    def __init__(self, network: Any) -> None:
        super().__init__()
        self.backbone, self.head, self.coder = network.backbone, network.rpn.head, network.rpn.box_coder
        normal = network.transform
        self.register_buffer("mean", torch.tensor(normal.image_mean).reshape(3, 1, 1))
        self.register_buffer("deviation", torch.tensor(normal.image_std).reshape(3, 1, 1))
        blank = torch.zeros(1, 3, *reversed(INPUT_PX))
        with torch.no_grad():
            levels = list(self.backbone(blank).values())
            anchors = network.rpn.anchor_generator(ImageList(blank, [blank.shape[-2:]]), levels)[0]
        self.register_buffer("anchors", anchors)

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        levels = self.backbone((image + 0.5 - self.mean) / self.deviation)
        scores, deltas = concat_box_prediction_layers(*self.head(list(levels.values())))
        return torch.sigmoid(scores)[:, 0], self.coder.decode_single(deltas, self.anchors), levels[FINEST]


class Head(nn.Module):
    """The second stage, for export: features and boxes (REGIONS, 4) to shares of classes and the boxes of each."""

    def __init__(self, network: Any) -> None:
        super().__init__()
        heads = network.roi_heads
        self.head, self.predictor, self.coder = heads.box_head, heads.box_predictor, heads.box_coder
        self.scale = 0.25

    def forward(self, features: Tensor, regions: Tensor) -> tuple[Tensor, Tensor]:
        rows = torch.cat([torch.zeros_like(regions[:, :1]), regions], dim=1)
        pooled = torch.ops.torchvision.roi_align(features, rows, self.scale, POOLED, POOLED, 2, False)
        logits, deltas = self.predictor(self.head(pooled))
        classes = logits.shape[1]
        found = self.coder.decode_single(deltas, regions).reshape(len(regions), classes, 4)
        return torch.softmax(logits, dim=1), found
