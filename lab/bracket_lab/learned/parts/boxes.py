"""Faster R-CNN's boxes without torch: regions, the surest of those that overlap, and their types."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from bracket_cell.learned.inference.onnx_model import Network, OnnxModel
from bracket_cell.learned.parts.maps import INPUT_PX, Peak, network_input
from bracket_cell.learned.parts.model import POSE_KIND, PosedPartDetector, pose_file
from bracket_ground.files.files import shipped
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.planning import weights_file
from bracket_ground.interfaces.product import PartType, Product

KIND, HEAD_KIND = "parts.rcnn", "parts.rcnn_head"
REGIONS = 64  # that the second stage looks at: trays hold ten things
CONSIDERED, REGIONS_APART, BOXES_APART = 400, 0.7, 0.5  # surest regions; intersection over union of two kept ones
LEAST_SCORE = 0.1
LEAST_SIDE_PX = 2.0
TURNS = 8  # directions of an axis that are tried, within half a turn

Boxes = NDArray[np.float32]


def head_file(regions: Path) -> Path:
    """Where the second stage is that belongs to a first one."""
    return regions.with_name(f"{regions.stem}_head{regions.suffix}")


def pose_file_of(regions: Path) -> Path:
    """The pose net that belongs to a first stage: the centre net's beside it, or else the shipped one."""
    beside = pose_file(regions.with_name(weights_file("parts", "centre")))
    return beside if beside.is_file() else shipped("bracket_cell.learned", "weights", beside.name)


def box_files(weights: Path | None, folder: Path) -> dict[str, Path]:
    """All files of the detector; by default those of a folder."""
    regions = weights or folder / weights_file("parts", "rcnn")
    return {"parts": regions, "parts.head": head_file(regions), "parts.pose": pose_file_of(regions)}


class BoxPartDetector(PosedPartDetector):
    """By Faster R-CNN, whose boxes tell no direction: the pose net tries TURNS of them for each."""

    def __init__(self, bench: Bench, product: Product, regions: Network, head: Network, pose: Network) -> None:
        super().__init__(bench, product, regions, head, pose)
        self._regions, self._head = regions, head

    @staticmethod
    def load(bench: Bench, product: Product, weights: Path) -> BoxPartDetector:
        """With the networks of three files: the first stage's, the second's beside it, and a pose net's.

        Raises:
            ModelError: a file is missing, damaged, of another kind, or trained for other parts.
        """
        first, second = OnnxModel.load(weights, KIND), OnnxModel.load(head_file(weights), HEAD_KIND)
        return BoxPartDetector(bench, product, first, second, OnnxModel.load(pose_file_of(weights), POSE_KIND))

    def _peaks(self, image: NDArray[np.uint8]) -> tuple[list[Peak], NDArray[np.float32] | None]:
        first = self._regions.run({"image": network_input(image)})
        chosen = surest_regions(first["scores"], first["boxes"])
        second = self._head.run({"features": first["features"], "regions": chosen})
        return boxed(second["shares"], second["boxes"]), None

    def _turns(self, kind: PartType) -> Sequence[float]:
        whole = math.pi if kind.alike_after_half_turn else 2 * math.pi
        return tuple(number * math.pi / TURNS for number in range(round(TURNS * whole / math.pi)))


def surest_regions(scores: NDArray[np.float32], boxes: Boxes) -> Boxes:
    """(REGIONS, 4) boxes inside the image that may hold a thing, the surest of those that overlap."""
    order = np.argsort(-scores)[:CONSIDERED]
    inside = _clipped(boxes[order])
    kept = _apart(inside, scores[order], REGIONS_APART)[:REGIONS]
    found = np.zeros((REGIONS, 4), np.float32)
    found[:, 2:] = LEAST_SIDE_PX  # those that are left over are in a corner, where nothing is
    found[: len(kept)] = inside[kept]
    return found


def boxed(shares: NDArray[np.float32], boxes: NDArray[np.float32]) -> list[Peak]:
    """What the second stage says, the surest first.

    Args:
        shares: (n, types + 2) of each region: background, types, unknown.
        boxes: (n, types + 2, 4) of the region as each of them.
    """
    found = []
    for kind in range(shares.shape[1] - 1):
        scores, own = shares[:, kind + 1], _clipped(boxes[:, kind + 1])
        rows = np.flatnonzero(scores > LEAST_SCORE)
        for row in rows[_apart(own[rows], scores[rows], BOXES_APART)]:
            box = own[row].astype(float)
            middle = (box[:2] + box[2:]) / 2
            found.append(Peak(kind, float(scores[row]), middle, box, 0.0, 0.0, 0.5, (0, 0)))
    return sorted(found, key=lambda peak: -peak.score)


def _clipped(boxes: Boxes) -> Boxes:
    return np.clip(boxes, 0, np.array([*INPUT_PX, *INPUT_PX], np.float32))


def _apart(boxes: Boxes, scores: NDArray[np.float32], most: float) -> NDArray[np.int64]:
    """Rows of boxes that are large enough and of which none overlaps a surer one by more, the surest first."""
    sizes = boxes[:, 2:] - boxes[:, :2]
    large = np.flatnonzero((sizes >= LEAST_SIDE_PX).all(axis=1))
    spots = np.hstack([boxes[:, :2], sizes])[large].tolist()
    kept = cv2.dnn.NMSBoxes(spots, scores[large].tolist(), 0.0, most)
    return large[np.array(kept, np.int64).reshape(-1)]
