"""Faster R-CNN over the 31 classes, and the features of regions that planners read from its frozen backbone."""

from __future__ import annotations

import io
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torchvision.models.detection import FasterRCNN, fasterrcnn_mobilenet_v3_large_320_fpn
from torchvision.models.detection.backbone_utils import resnet_fpn_backbone
from torchvision.models.detection.faster_rcnn import FastRCNNPredictor, TwoMLPHead

from cell.errors import InputError, ModelError, Place, Problem
from cell.files.files import write_whole
from cell.interfaces.pose import Array
from cell.interfaces.stacks import StackedScene
from learned.lab.stacks.settings import WHOLE, StackTraining
from learned.training.training_loop import Checkpoint, fit

SIDE_PX = {False: (240, 320), True: (600, 1000)}  # least and greatest side of the input, of the small network and whole
POOLED = 3  # side of the grid of features of a region
LEAST_SCORE, OVERLAP = 0.3, 0.5
MOST_FOUND = 8
REGIONS = 32  # of an image, that a step learns from: pictures hold five things
PROPOSALS = 200  # of an image, in training; of the small network
SMALL_HEAD = 256  # width of its two fully connected layers
LARGEST_GRADIENT = 10.0
DEVICE = torch.device("cuda" if torch.cuda.is_available() else "cpu")


def detector(settings: StackTraining) -> nn.Module:
    """An untrained network; its backbone is frozen when planners learn."""
    whole, classes = settings.share == WHOLE, len(settings.classes) + 1
    least, greatest = SIDE_PX[whole]
    options = {
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
        large: nn.Module = FasterRCNN(body, classes, **options)
        return large
    options |= {"rpn_pre_nms_top_n_train": PROPOSALS, "rpn_post_nms_top_n_train": PROPOSALS}
    found: Any = fasterrcnn_mobilenet_v3_large_320_fpn(
        weights=None, weights_backbone=None, num_classes=classes, **options
    )
    channels, side = found.backbone.out_channels, found.roi_heads.box_roi_pool.output_size[0]
    found.roi_heads.box_head = TwoMLPHead(channels * side**2, SMALL_HEAD)
    found.roi_heads.box_predictor = FastRCNNPredictor(SMALL_HEAD, classes)
    small: nn.Module = found
    return small


def read_image(path: Path) -> NDArray[np.uint8]:
    """A picture (height, width, 3), RGB.

    Raises:
        InputError: it cannot be read as one.
    """
    image = cv2.imread(str(path))
    if image is None:
        raise InputError(Problem(Place(path), "cannot be read as a picture", "a JPEG file is wanted"))
    rgb: NDArray[np.uint8] = cv2.cvtColor(image, cv2.COLOR_BGR2RGB).astype(np.uint8)
    return rgb


def train_detector(
    scenes: Sequence[StackedScene],
    images: Sequence[Path],
    seed: int,
    settings: StackTraining,
    *,
    checkpoint: Checkpoint | None = None,
    quiet: bool = True,
) -> nn.Module:
    """A trained network; half of the pictures it sees are mirrored. On a GPU it is a little otherwise each time."""
    torch.manual_seed(seed)
    rng, network = np.random.default_rng([seed, 21]), detector(settings).to(DEVICE)
    schedule = settings.detector
    network.train()
    optimiser = torch.optim.AdamW(network.parameters(), schedule.peak_rate, weight_decay=schedule.weight_decay)
    batches = max(1, len(scenes) // schedule.batch)

    def losses(_: int) -> Iterator[Tensor]:
        for chosen in np.array_split(rng.permutation(len(scenes))[: batches * schedule.batch], batches):
            mirrored = rng.random(len(chosen)) < 0.5
            pairs = zip(chosen.tolist(), mirrored.tolist(), strict=True)
            seen = [
                _example(scenes[index], read_image(images[index]), turned, settings.classes) for index, turned in pairs
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


def as_input(image: NDArray[np.uint8]) -> Tensor:
    """(3, height, width) from 0 to 1."""
    return torch.from_numpy(np.ascontiguousarray(image.transpose(2, 0, 1))).to(DEVICE).float() / 255


def mirrored_boxes(boxes: Array, width_px: int) -> Array:
    """Boxes (n, 4) in the picture turned over."""
    turned: Array = np.column_stack([width_px - boxes[:, 2], boxes[:, 1], width_px - boxes[:, 0], boxes[:, 3]])
    return turned


def boxes_of(scene: StackedScene) -> Array:
    """(n, 4) of a scene."""
    return np.array([one.box_px for one in scene.objects], dtype=float).reshape(-1, 4)


def _example(
    scene: StackedScene, image: NDArray[np.uint8], mirrored: bool, classes: Sequence[str]
) -> tuple[Tensor, dict[str, Tensor]]:
    boxes = boxes_of(scene)
    if mirrored:
        image, boxes = image[:, ::-1], mirrored_boxes(boxes, image.shape[1])
    labels = [classes.index(one.name) + 1 for one in scene.objects]
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


def load_detector(path: Path, settings: StackTraining) -> nn.Module:
    """Weights that `save_detector` wrote.

    Raises:
        ModelError: there are none, or of another network.
    """
    network = detector(settings)
    try:
        network.load_state_dict(torch.load(path, map_location="cpu", weights_only=True))
    except (OSError, RuntimeError) as error:
        raise ModelError(f"{path}: no weights of this detector; remove the file to train it anew") from error
    return network.eval()
