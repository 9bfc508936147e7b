"""Faster R-CNN as the paper has it (ResNet-101 with a feature pyramid), and smaller ones beside it. Imports torch.

It answers boxes and types, not poses: it is a baseline of detection, trained from scratch, as no weights are fetched.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from torchvision.models.detection import FasterRCNN, fasterrcnn_mobilenet_v3_large_320_fpn
from torchvision.models.detection.anchor_utils import AnchorGenerator
from torchvision.models.detection.backbone_utils import resnet_fpn_backbone

from cell.interfaces.product import Product
from learned.exposure import POOR, levelled, spoiled
from learned.fitting import Checkpoint, fit
from learned.parts.dataset import UNKNOWN, Scene
from learned.parts.evaluate import IOU, LEAST_SHOWN, average_precision
from learned.parts.maps import INPUT_PX, network_input, overlap
from learned.stills import data_hash

BACKBONES = ("resnet101", "resnet50", "resnet18", "mobilenet")
ANCHORS_PX, RATIOS = ((32,), (64,), (128,), (256,), (512,)), (0.5, 1.0, 2.0)  # as the paper and torchvision
LEAST_SCORE = 0.05


@dataclass(frozen=True)
class RcnnTraining:
    """Training of a Faster R-CNN: AdamW with a one-cycle schedule."""

    backbone: str = "resnet101"
    steps: int = 2000
    batch: int = 4
    peak_rate: float = 5e-4
    weight_decay: float = 1e-4


def rcnn(backbone: str, types: int) -> nn.Module:
    """An untrained network for so many types and unknown things; batches are normalised, as nothing is frozen."""
    classes = types + 2  # the background is the first
    width, height = INPUT_PX
    if backbone == "mobilenet":
        small: nn.Module = fasterrcnn_mobilenet_v3_large_320_fpn(
            weights=None, weights_backbone=None, num_classes=classes, min_size=height, max_size=width
        )
        return small
    body = resnet_fpn_backbone(backbone_name=backbone, weights=None, norm_layer=nn.BatchNorm2d, trainable_layers=5)
    anchors = AnchorGenerator(ANCHORS_PX, (RATIOS,) * len(ANCHORS_PX))
    network: nn.Module = FasterRCNN(
        body, classes, min_size=height, max_size=width, rpn_anchor_generator=anchors, box_score_thresh=LEAST_SCORE
    )
    return network


def train_rcnn(
    scenes: Sequence[Scene],
    product: Product,
    seed: int,
    settings: RcnnTraining,
    *,
    checkpoint: Path | None = None,
    quiet: bool = True,
) -> nn.Module:
    """A trained network; interrupted and begun again it goes on from its checkpoint."""
    torch.manual_seed(seed)
    rng, types = np.random.default_rng([seed, 4]), tuple(product.parts)
    network = rcnn(settings.backbone, len(types))
    network.train()
    optimiser = torch.optim.AdamW(network.parameters(), settings.peak_rate, weight_decay=settings.weight_decay)
    rounds = max(1, min(20, settings.steps))

    def losses(_: int) -> Iterator[Tensor]:
        for _ in range(max(1, settings.steps // rounds)):
            chosen = [scenes[int(index)] for index in rng.integers(len(scenes), size=settings.batch)]
            seen = [spoiled(scene.image, rng, camera=POOR) for scene in chosen]
            images = [torch.from_numpy(network_input(image)[0] + 0.5) for image in seen]
            yield sum(network(images, [targets(scene, types) for scene in chosen]).values())

    identity = f"{data_hash(scenes)} {settings} {seed}"
    kept = None if checkpoint is None else Checkpoint(checkpoint, identity)
    batches = max(1, settings.steps // rounds)
    fit(network, optimiser, losses, rounds, batches, largest_gradient=10.0, rng=rng, checkpoint=kept, quiet=quiet)
    return network


def targets(scene: Scene, types: tuple[str, ...]) -> dict[str, Tensor]:
    """Boxes (n, 4) of whole things, what hides them included, and their classes (n,), in the network's input."""
    height, width = scene.image.shape[:2]
    scale = np.tile([INPUT_PX[0] / width, INPUT_PX[1] / height], 2)
    labels = [label for label in scene.labels if label.shown >= LEAST_SHOWN]
    boxes = np.array([label.box_px * scale for label in labels], np.float32).reshape(-1, 4)
    kinds = [len(types) + 1 if label.part == UNKNOWN else types.index(label.part) + 1 for label in labels]
    return {"boxes": torch.from_numpy(boxes), "labels": torch.tensor(kinds, dtype=torch.int64)}


def score_rcnn(network: nn.Module, scenes: Sequence[Scene], product: Product) -> dict[str, float]:
    """Mean average precision over the product's types, at IoU .5 and averaged over .5 to .95."""
    types = tuple(product.parts)
    found: dict[tuple[int, int], list[tuple[float, bool]]] = {}
    counts = dict.fromkeys(range(1, len(types) + 1), 0)
    network.eval()
    for scene in scenes:
        with torch.no_grad():
            answer = network([torch.from_numpy(network_input(levelled(scene.image))[0] + 0.5)])[0]
        truth = targets(scene, types)
        for kind in counts:
            true = truth["boxes"][truth["labels"] == kind].numpy().astype(float)
            own = answer["labels"] == kind
            boxes, scores = answer["boxes"][own].numpy().astype(float), answer["scores"][own].tolist()
            counts[kind] += len(true)
            for level, least in enumerate(IOU):
                found.setdefault((kind, level), []).extend(_matched(boxes, scores, true, least))
    precisions = [
        [average_precision(found[kind, level], count) for level in range(len(IOU))]
        for kind, count in counts.items()
        if count
    ]
    return {"map_50": float(np.mean([each[0] for each in precisions])), "map_50_95": float(np.mean(precisions))}


def _matched(
    boxes: np.ndarray[tuple[int, ...], np.dtype[np.float64]],
    scores: Sequence[float],
    true: np.ndarray[tuple[int, ...], np.dtype[np.float64]],
    least: float,
) -> list[tuple[float, bool]]:
    """The surest answer takes the best box first."""
    free, told = list(range(len(true))), []
    for index in np.argsort(scores)[::-1]:
        best = max(free, key=lambda one: overlap(boxes[index], true[one]), default=None)
        right = False
        if best is not None and overlap(boxes[index], true[best]) >= least:
            free.remove(best)
            right = True
        told.append((scores[int(index)], right))
    return told
