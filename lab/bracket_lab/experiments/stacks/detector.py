"""Faster R-CNN over the 31 classes, and the features of regions that planners read from its frozen backbone."""

from __future__ import annotations

import io
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torchvision.models.detection import FasterRCNN
from torchvision.models.detection.anchor_utils import AnchorGenerator
from torchvision.models.detection.backbone_utils import resnet_fpn_backbone
from torchvision.models.detection.faster_rcnn import FastRCNNPredictor, TwoMLPHead
from torchvision.ops import MultiScaleRoIAlign

from bracket_cell.learned.records import read_image
from bracket_ground.errors import ModelError
from bracket_ground.files.files import write_whole
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.stacks import StackedScene
from bracket_lab.experiments.stacks.checks import WHOLE, StackTraining
from bracket_lab.learned.training.pretrained import GREY, PYRAMID, SPREAD, efficient_body
from bracket_lab.learned.training.training_loop import Checkpoint, fit

SIDE_PX = {False: (240, 320), True: (600, 1000)}  # least and greatest side of the input, of the small network and whole
POOLED = 3  # side of the grid of features of a region
LEAST_SCORE, OVERLAP = 0.6, 0.5  # chosen on pictures for training: most pictures with all their objects and no others
MOST_FOUND = 8
REGIONS = 32  # of an image, that a step learns from: pictures hold five things
PROPOSALS = 200  # of an image, in training; of the small network
SMALL_HEAD = 256  # width of its two fully connected layers
ANCHORS_PX, RATIOS = ((24,), (48,), (96,), (192,), (384,)), (0.5, 1.0, 2.0)  # of each level, and width to height
FINEST, POOLED_FINE = "0", 7  # all boxes are cut out of the finest level, into so many cells each way
LARGEST_GRADIENT = 10.0
BODY_RATE = 0.3  # of the others' learning rate: the backbone is to keep what it knows
GAINS, OFFSET = (0.7, 1.35), 15.0  # of the light in training
DEVICE = torch.device("cuda" if torch.cuda.is_available() else "cpu")


def detector(settings: StackTraining) -> FasterRCNN:
    """A network whose heads are untrained; its backbone is frozen when planners learn.

    Raises:
        InputError: the small one begins with a backbone that knows everyday pictures, which is not installed.
    """
    whole, classes = settings.share == WHOLE, len(settings.classes) + 1
    least, greatest = SIDE_PX[whole]
    options: dict[str, Any] = {
        "min_size": least,
        "max_size": greatest,
        "box_score_thresh": LEAST_SCORE,
        "box_detections_per_img": MOST_FOUND,
        "box_nms_thresh": OVERLAP,
        "box_batch_size_per_image": REGIONS,
    }
    if whole:
        body = resnet_fpn_backbone(
            backbone_name="resnet101", weights=None, norm_layer=nn.BatchNorm2d, trainable_layers=5
        )
        return FasterRCNN(body, classes, **options)
    return FasterRCNN(
        efficient_body("the detector of stacks"),
        rpn_anchor_generator=AnchorGenerator(ANCHORS_PX, (RATIOS,) * len(ANCHORS_PX)),
        rpn_pre_nms_top_n_train=PROPOSALS,
        rpn_post_nms_top_n_train=PROPOSALS,
        box_roi_pool=MultiScaleRoIAlign([FINEST], POOLED_FINE, 2),
        box_head=TwoMLPHead(PYRAMID * POOLED_FINE**2, SMALL_HEAD),
        box_predictor=FastRCNNPredictor(SMALL_HEAD, classes),
        image_mean=(GREY,) * 3,
        image_std=(SPREAD,) * 3,
        **options,
    )


def train_detector(
    scenes: Sequence[StackedScene],
    images: Sequence[Path],
    seed: int,
    settings: StackTraining,
    *,
    checkpoint: Checkpoint | None = None,
    quiet: bool = True,
) -> FasterRCNN:
    """A trained network, of pictures mirrored and lit at random. On a GPU it is a little otherwise each time."""
    torch.manual_seed(seed)
    rng, network = np.random.default_rng([seed, 21]), detector(settings).to(DEVICE)
    schedule = settings.detector
    network.train()
    body = list(network.backbone.body.parameters())
    heads = [weights for name, weights in network.named_parameters() if not name.startswith("backbone.body.")]
    groups: list[dict[str, Any]] = [{"params": body, "lr": schedule.peak_rate * BODY_RATE}, {"params": heads}]
    optimiser = torch.optim.AdamW(groups, schedule.peak_rate, weight_decay=schedule.weight_decay)
    batches = max(1, len(scenes) // schedule.batch)

    def losses(_: int) -> Iterator[Tensor]:
        for chosen in np.array_split(rng.permutation(len(scenes))[: batches * schedule.batch], batches):
            mirrored = rng.random(len(chosen)) < 0.5
            pairs = zip(chosen.tolist(), mirrored.tolist(), strict=True)
            seen = [
                _example(scenes[index], _lit(read_image(images[index]), rng), turned, settings.classes)
                for index, turned in pairs
            ]
            yield sum(network([image for image, _ in seen], [target for _, target in seen]).values())

    fit(
        network,
        optimiser,
        losses,
        schedule.epochs,
        batches,
        largest_gradient=LARGEST_GRADIENT,
        rng=rng,
        checkpoint=checkpoint,
        quiet=quiet,
    )
    return network


def _lit(image: NDArray[np.uint8], rng: np.random.Generator) -> NDArray[np.uint8]:
    """In another light: each colour brighter or darker."""
    lit = image * rng.uniform(*GAINS, 3) + rng.uniform(-OFFSET, OFFSET)
    found: NDArray[np.uint8] = lit.clip(0, 255).astype(np.uint8)
    return found


def as_input(image: NDArray[np.uint8]) -> Tensor:
    """(3, height, width) from 0 to 1."""
    return torch.from_numpy(np.ascontiguousarray(image.transpose(2, 0, 1))).to(DEVICE).float() / 255


def mirrored_boxes(boxes: Array, width_px: int) -> Array:
    """Boxes (n, 4) in the picture turned over."""
    turned: Array = np.column_stack([width_px - boxes[:, 2], boxes[:, 1], width_px - boxes[:, 0], boxes[:, 3]])
    return turned


def boxes_of(scene: StackedScene) -> Array:
    """(n, 4) of a scene."""
    return np.array([item.box_px for item in scene.objects], dtype=float).reshape(-1, 4)


def _example(
    scene: StackedScene, image: NDArray[np.uint8], mirrored: bool, classes: Sequence[str]
) -> tuple[Tensor, dict[str, Tensor]]:
    boxes = boxes_of(scene)
    if mirrored:
        image, boxes = image[:, ::-1], mirrored_boxes(boxes, image.shape[1])
    labels = [classes.index(item.name) + 1 for item in scene.objects]
    target = {"boxes": torch.from_numpy(boxes).float(), "labels": torch.tensor(labels)}
    return as_input(image), {name: values.to(DEVICE) for name, values in target.items()}


class Regions:
    """Reads a trained detector's features of any boxes, and what it finds itself."""

    def __init__(self, network: nn.Module, classes: Sequence[str]) -> None:
        torch.set_num_threads(1)
        self._classes = classes
        self._network: Any = network.eval().to(DEVICE)

    @property
    def width(self) -> int:
        """Of the features of a box."""
        return int(self._network.backbone.out_channels) * POOLED**2

    def features(self, image: NDArray[np.uint8], boxes: Array) -> NDArray[np.float16]:
        """(n, channels POOLED POOLED) of boxes (n, 4) in pixels."""
        with torch.no_grad():
            batch, _ = self._network.transform([as_input(image)])
            maps = self._network.backbone(batch.tensors)
            maps = OrderedDict([("0", maps)]) if isinstance(maps, Tensor) else maps
            height, width = batch.image_sizes[0]
            scale = np.tile([width / image.shape[1], height / image.shape[0]], 2)
            asked = torch.from_numpy(boxes * scale).float().to(DEVICE)
            pooled = self._network.roi_heads.box_roi_pool(maps, [asked], batch.image_sizes)
            small = nn.functional.adaptive_avg_pool2d(pooled, POOLED)
        found: NDArray[np.float16] = small.flatten(1).cpu().numpy().astype(np.float16)
        return found

    def found(self, image: NDArray[np.uint8]) -> tuple[Array, list[str], list[float]]:
        """Boxes (n, 4), their classes and scores."""
        with torch.no_grad():
            answer = {name: values.cpu() for name, values in self._network([as_input(image)])[0].items()}
        names = [self._classes[int(label) - 1] for label in answer["labels"]]
        return answer["boxes"].numpy().astype(float), names, [float(score) for score in answer["scores"]]


def save_detector(network: nn.Module, path: Path) -> None:
    """Write the weights."""
    written = io.BytesIO()
    torch.save(network.state_dict(), written)
    write_whole(path, written.getvalue())


def load_detector(path: Path, settings: StackTraining) -> FasterRCNN:
    """Weights that `save_detector` wrote.

    Raises:
        ModelError: there are none, or of another network.
    """
    network = detector(settings)
    try:
        network.load_state_dict(torch.load(path, map_location="cpu", weights_only=True))
    except (OSError, RuntimeError) as error:
        raise ModelError(f"{path}: no weights of this detector; remove the file to train it anew") from error
    network.eval()
    return network
