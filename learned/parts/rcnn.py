"""Faster R-CNN as the paper has it (ResNet-101 with a feature pyramid), and smaller ones beside it. Imports torch.

It answers boxes and types, not poses: it is a baseline of detection, trained from scratch, as no weights are fetched.
"""

from __future__ import annotations

import io
import pickle
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from torchvision.models.detection import FasterRCNN, fasterrcnn_mobilenet_v3_large_320_fpn
from torchvision.models.detection.anchor_utils import AnchorGenerator
from torchvision.models.detection.backbone_utils import resnet_fpn_backbone

from cell.errors import ModelError
from cell.files.files import write_whole
from cell.interfaces.perception import PartDetection
from cell.interfaces.pose import Pose
from cell.interfaces.product import Product
from learned.inference.exposure import POOR, levelled, spoiled
from learned.inference.onnx_model import ModelCard
from learned.parts.data import UNKNOWN, Scene
from learned.parts.evaluate import LEAST_SHOWN, Findings, judge
from learned.parts.maps import INPUT_PX, network_input
from learned.training.still_dataset import data_hash
from learned.training.training_loop import Checkpoint, fit

ANCHORS_PX, RATIOS = ((32,), (64,), (128,), (256,), (512,)), (0.5, 1.0, 2.0)  # as the paper and torchvision
LEAST_SCORE = 0.05
SMALL_REGIONS = 64  # of an image, that the small one learns from in a step; as in Fast R-CNN: trays hold ten things
KIND = "parts.rcnn"
SCORES = "things", "map_50", "map_50_95", "ap_50_unknown", "processor_ms_p50", "processor_ms_p95"  # boxes have no more


@dataclass(frozen=True)
class RcnnTraining:
    """Training of a Faster R-CNN: AdamW with a one-cycle schedule."""

    backbone: str = "resnet101"
    steps: int = 2000
    batch: int = 4
    peak_rate: float = 5e-4
    weight_decay: float = 1e-4


def rcnn(backbone: str, types: int) -> nn.Module:
    """An untrained network for a number of types and unknown things; batches are normalised, as nothing is frozen."""
    classes = types + 2  # the background is the first
    width, height = INPUT_PX
    if backbone == "mobilenet":
        small: nn.Module = fasterrcnn_mobilenet_v3_large_320_fpn(
            weights=None,
            weights_backbone=None,
            num_classes=classes,
            min_size=height,
            max_size=width,
            box_batch_size_per_image=SMALL_REGIONS,
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


def write_rcnn(
    network: nn.Module,
    out: Path,
    product: Product,
    scenes: Sequence[Scene],
    settings: RcnnTraining,
    seed: int,
    command: str,
) -> dict[str, float]:
    """Weights and card in a file of torch, as no cell runs it.

    Returns:
        What was learned from.

    Raises:
        InputError: the file cannot be written.
    """
    facts = {"images": float(len(scenes)), "things": float(sum(len(scene.labels) for scene in scenes))}
    card = ModelCard(
        kind=KIND,
        config=asdict(settings),
        vocabulary={"parts": tuple(product.parts)},
        data_sha256=data_hash(scenes),
        scores=facts,
        command=command,
        seed=seed,
    )
    written = io.BytesIO()
    torch.save({"card": card.model_dump_json(), "network": network.state_dict()}, written)
    write_whole(out, written.getvalue())
    return facts


def load_rcnn(path: Path, product: Product) -> nn.Module:
    """A network that `write_rcnn` wrote, ready to answer.

    Raises:
        ModelError: the file is missing, is none of these, or was trained for other parts.
    """
    try:
        kept = torch.load(path, weights_only=True)
        card = ModelCard.model_validate_json(kept["card"])
        network = rcnn(str(card.config["backbone"]), len(card.vocabulary["parts"]))
        network.load_state_dict(kept["network"])
    except OSError as error:
        raise ModelError(f"{path}: cannot read the weights: {error.strerror}") from error
    except (KeyError, TypeError, ValueError, RuntimeError, pickle.UnpicklingError) as error:
        raise ModelError(f"{path}: not weights of `cell lab train parts --kind rcnn`, or damaged") from error
    card.require_vocabulary(path, {"parts": tuple(product.parts)})
    return network.eval()


def score_rcnn(network: nn.Module, scenes: Sequence[Scene], product: Product) -> dict[str, float]:
    """Scores of boxes, as those of part detectors are."""
    findings = Findings()
    network.eval()
    torch.set_num_threads(1)
    for scene in scenes:
        began_s = time.process_time()
        answers = _answers(network, scene, tuple(product.parts))
        findings.seconds.append(time.process_time() - began_s)
        judge(scene, answers, product, findings)
    return {name: value for name, value in findings.scores(product).items() if name in SCORES}


def _answers(network: nn.Module, scene: Scene, types: tuple[str, ...]) -> list[PartDetection]:
    """Boxes in pixels of the camera; where things are is not told."""
    height, width = scene.image.shape[:2]
    scale = np.tile([width / INPUT_PX[0], height / INPUT_PX[1]], 2)
    with torch.no_grad():
        answer = network([torch.from_numpy(network_input(levelled(scene.image))[0] + 0.5)])[0]
    names, nowhere = (*types, UNKNOWN), Pose((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
    found = []
    for box, label, score in zip(answer["boxes"].numpy(), answer["labels"], answer["scores"], strict=True):
        left, top, right, bottom = (round(float(side)) for side in box * scale)
        sides = (left, top, right, bottom)
        found.append(PartDetection(names[int(label) - 1], float(score), nowhere, (0.0, 0.0, 0.0), sides, upright=False))
    return found
