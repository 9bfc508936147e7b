"""A user's own detector of boxes, YOLO or RT-DETR: an ONNX file without a card, and a pose net beside it.

Its classes are the metadata's `names`, as Ultralytics writes them, or else the product's types in their order. Outputs
are read as (1, 4 + classes, n) of YOLOv8 and later, (1, n, 5 + classes) of YOLOv5, or (1, n, 6) where the file has its
own suppression: left, top, right, bottom, score, class. RT-DETR tells boxes as shares of the picture: as (1, n, 4 +
classes) where Ultralytics wrote it, or as `logits` (1, n, classes) and `pred_boxes` (1, n, 4), of Transformers.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from bracket_cell.learned.inference.onnx_model import ForeignModel, Network, OnnxModel
from bracket_cell.learned.parts.maps import INPUT_PX, Peak
from bracket_cell.learned.parts.model import POSE_KIND, PosedPartDetector, pose_file
from bracket_ground.errors import ModelError
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.product import PartType, Product

USUAL_PX = 640  # side of the input where the file leaves it open
LEAST_SCORE, APART, MOST = 0.25, 0.5, 60  # YOLO's usual score; intersection over union of two kept boxes; their number
MOST_SCORE, FARTHEST = 1.05, 10.0  # of a sure box: what rounding makes of a probability; sides of the picture
GREY = 114  # around a picture of another shape, as YOLO has it
MOST_OF_ITS_OWN = 1000  # boxes of a file with its own suppression; one without it has thousands
MOST_SHARE = 1.5  # of a box told as shares of the picture: it may reach over an edge
TURNS = 8  # directions of an axis that the pose net tries, within half a turn

Rows = NDArray[np.float32]


def onnx_files(weights: Path | None, folder: Path) -> dict[str, Path]:
    """The file, and the pose net beside it where one is."""
    del folder
    if weights is None:
        return {}
    beside = pose_file(weights)
    return {"parts": weights} | ({"parts.pose": beside} if beside.is_file() else {})


class YoloPartDetector(PosedPartDetector):
    """Boxes of a user's own network; exact poses where a pose net of this product lies beside it."""

    def __init__(self, bench: Bench, product: Product, boxes: ForeignModel, pose: Network | None) -> None:
        super().__init__(bench, product, pose)
        self._boxes = boxes
        names = names_of(boxes, tuple(product.parts))
        by_name = {name.casefold(): number for number, name in enumerate(product.parts)}
        self._kinds = [by_name.get(name.casefold(), len(by_name)) for name in names]
        if all(kind == len(by_name) for kind in self._kinds):
            has, wants = ", ".join(names), ", ".join(product.parts)
            raise ModelError(f"{boxes.path}: knows {has}, and none of this product's parts: {wants}")
        self._peaks(np.full((*INPUT_PX[::-1], 3), GREY, np.uint8))  # what it cannot read is said before a run

    @staticmethod
    def load(bench: Bench, product: Product, weights: Path) -> YoloPartDetector:
        """With the network of a file.

        Raises:
            ModelError: it cannot be read, or knows none of the product's parts.
        """
        beside = pose_file(weights)
        pose = OnnxModel.load(beside, POSE_KIND) if beside.is_file() else None
        return YoloPartDetector(bench, product, ForeignModel.load(weights), pose)

    def _peaks(self, image: NDArray[np.uint8]) -> tuple[list[Peak], NDArray[np.float32] | None]:
        size_px = self._boxes.input_px(USUAL_PX)
        given, scale, shift = letterboxed(image, size_px)
        boxes, scores, classes = read_boxes(self._boxes.run(given), len(self._kinds), size_px, self._boxes.path)
        onto = np.tile(np.array(INPUT_PX) / image.shape[1::-1], 2)
        found = []
        for row in _surest(boxes, scores, classes):
            box = (boxes[row].astype(float) - np.tile(shift, 2)) / scale * onto
            middle, kind = (box[:2] + box[2:]) / 2, self._kinds[classes[row]]
            upright = 0.0 if self._pose is None else 0.5
            found.append(Peak(kind, float(scores[row]), middle, box, 0.0, 0.0, upright, (0, 0)))
        return found, None

    def _turns(self, kind: PartType) -> Sequence[float]:
        whole = math.pi if kind.alike_after_half_turn else 2 * math.pi
        return tuple(number * math.pi / TURNS for number in range(round(TURNS * whole / math.pi)))


def names_of(boxes: ForeignModel, usual: tuple[str, ...]) -> tuple[str, ...]:
    """The classes of a network.

    Raises:
        ModelError: its metadata tell them in no known way.
    """
    text = boxes.metadata.get("names")
    if text is None:
        return usual
    try:
        names = ast.literal_eval(text)
    except (ValueError, SyntaxError, RecursionError, MemoryError):
        names = None
    if isinstance(names, Mapping) and set(names) == set(range(len(names))):
        names = [names[number] for number in range(len(names))]
    if not isinstance(names, list | tuple) or not names:
        raise ModelError(f"{boxes.path}: its `names` are no list of classes: {text[:80]}")
    return tuple(str(name) for name in names)


def letterboxed(image: NDArray[np.uint8], size_px: tuple[int, int]) -> tuple[Rows, float, Rows]:
    """An image (1, 3, height, width), 0 to 1, whole within a size; by how much it is scaled and how far aside it is."""
    height, width = image.shape[:2]
    scale = min(size_px[0] / width, size_px[1] / height)
    small = cv2.resize(image, (max(1, round(width * scale)), max(1, round(height * scale))))
    left, top = (size_px[0] - small.shape[1]) // 2, (size_px[1] - small.shape[0]) // 2
    whole = np.full((size_px[1], size_px[0], 3), GREY, np.uint8)
    whole[top : top + small.shape[0], left : left + small.shape[1]] = small
    planes = whole.transpose(2, 0, 1)[np.newaxis].astype(np.float32) / np.float32(255)
    return planes, scale, np.array([left, top], np.float32)


def read_boxes(
    answers: Mapping[str, Rows], classes: int, size_px: tuple[int, int], path: Path
) -> tuple[Rows, Rows, NDArray[np.int64]]:
    """Boxes (n, 4) left, top, right, bottom in pixels of the input, scores (n,) and classes (n,), each sure enough.

    Raises:
        ModelError: the outputs have none of the known shapes, or are none of boxes.
    """
    boxes, scores, numbers = _rows(answers, classes, size_px, path)
    if np.abs(scores).max(initial=0.0) > MOST_SCORE:
        what = "export it with its last step (sigmoid)"
        raise ModelError(f"{path}: tells scores up to {np.abs(scores).max():.3g}; legal are 0 to 1: {what}")
    sure = scores > LEAST_SCORE
    boxes, scores, numbers = boxes[sure], scores[sure].clip(0, 1), numbers[sure]
    if wrong := [number for number in numbers.tolist() if number not in range(classes)]:
        raise ModelError(f"{path}: tells a class {wrong[0]:g}, but has {classes} names; legal are 0 to {classes - 1}")
    turned, far = (boxes[:, :2] > boxes[:, 2:]).any(axis=1), (np.abs(boxes) > FARTHEST * max(size_px)).any(axis=1)
    if len(odd := boxes[turned | far]):
        told = ", ".join(f"{side:.3g}" for side in odd[0].tolist())
        raise ModelError(f"{path}: tells a box ({told}); legal are left, top, right, bottom in pixels of its picture")
    return boxes, scores, numbers.astype(np.int64)


def _rows(answers: Mapping[str, Rows], classes: int, size_px: tuple[int, int], path: Path) -> tuple[Rows, Rows, Rows]:
    """The same as they are told."""
    answer = next(iter(answers.values()))
    if {"logits", "pred_boxes"} <= set(answers):
        boxes, odds = answers["pred_boxes"], answers["logits"].clip(-50, 50)
        fits = odds.ndim == 3 and boxes.shape == (1, odds.shape[1], 4) and odds.shape[2] == classes
        answer = np.concatenate([boxes, 1 / (1 + np.exp(-odds))], axis=2) if fits else odds
    rows = answer[0] if answer.ndim == 3 and len(answer) == 1 else np.empty((0, 0), np.float32)
    if rows.shape[1] == 4 + classes and rows[:, :4].max(initial=0.0) <= MOST_SHARE:
        rows = np.hstack([rows[:, :4] * np.tile(np.array(size_px, np.float32), 2), rows[:, 4:]])
    elif rows.shape[1] == 6 and len(rows) <= MOST_OF_ITS_OWN:
        return rows[:, :4], rows[:, 4], rows[:, 5]
    if rows.shape[0] == 4 + classes:
        rows = rows.T
    if rows.shape[1] == 4 + classes:
        shares = rows[:, 4:]
    elif rows.shape[1] == 5 + classes:
        shares = rows[:, 5:] * rows[:, 4:5]
    else:
        legal = f"(1, {4 + classes}, n), (1, n, {5 + classes}) or (1, n, 6)"
        raise ModelError(f"{path}: its output has the shape {answer.shape}; of {classes} classes legal are {legal}")
    half = rows[:, 2:4] / 2
    corners = np.hstack([rows[:, :2] - half, rows[:, :2] + half])
    return corners, shares.max(axis=1), shares.argmax(axis=1).astype(np.float32)


def _surest(boxes: Rows, scores: Rows, classes: NDArray[np.int64]) -> list[int]:
    """Rows of the surest boxes, of which none of a class overlaps a surer one."""
    likely = np.argsort(-scores, kind="stable")[:MOST_OF_ITS_OWN]
    spots = np.hstack([boxes[likely, :2], boxes[likely, 2:] - boxes[likely, :2]])
    kept = cv2.dnn.NMSBoxesBatched(spots.tolist(), scores[likely].tolist(), classes[likely].tolist(), 0.0, APART)
    order = sorted(np.array(kept, int).reshape(-1).tolist(), key=lambda row: -float(scores[likely[row]]))
    return [int(likely[row]) for row in order[:MOST]]
