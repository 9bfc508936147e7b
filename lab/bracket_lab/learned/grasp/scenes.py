"""Random cluttered trays with labels: who blocks whom, and the moves that free each part."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from bracket_cell.learned.grasp.boxes import Blocks, Boxes, bodies_overlap, sliding_distance_m
from bracket_cell.learned.grasp.candidates import graspable, touching
from bracket_cell.learned.grasp.settings import DetectionNoise, SceneSettings
from bracket_cell.learned.grasp.solution import Solution, nearest_first, solve
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import Product

Split = Literal["train", "validation", "test"]
_SPLIT_CODES: dict[Split, int] = {"train": 0, "validation": 1, "test": 2}
_PIXELS_PER_M = 1000.0
_PLACING_TRIES = 40  # at once
_HASHED_UNIT = 1e-7


@dataclass(frozen=True)
class Scene:
    """Parts as they stand, and as the detector saw them.

    Attributes:
        boxes: the truth.
        blocks: (n, candidates, n), [i, c, j] true where j would be touched in grasping i by candidate c.
        parts: one noisy detection of each, in the same order.
        noise: that the detections have.
        run: the recording that it is from; empty where it was drawn.
    """

    boxes: Boxes
    blocks: Blocks
    parts: tuple[PartDetection, ...]
    noise: DetectionNoise = field(default_factory=DetectionNoise)
    run: str = ""

    def graspable(self, required: int) -> bool:
        """Whether the gripper can take a part as it stands."""
        return bool(graspable(self.blocks)[required])

    def solution(self, required: int) -> Solution:
        """The fewest moves that free a part."""
        return solve(self.blocks, required, nearest_first(self.boxes, required))


def draw_scenes(
    product: Product,
    seed: int,
    count: int,
    split: Split,
    settings: SceneSettings | None = None,
    sizes: tuple[int, int] | None = None,
) -> Iterator[Scene]:
    """Scenes 0 .. count - 1 of a split; scene k is the same however many are drawn.

    Args:
        sizes: fewest and most parts, where they differ from the settings'.
    """
    settings = settings or SceneSettings()
    for index in range(count):
        rng = np.random.default_rng([seed, _SPLIT_CODES[split], index])
        boxes = _draw_boxes(product, rng, settings, sizes or settings.parts)
        yield Scene(boxes, touching(boxes, settings.outline), observe(boxes, rng, settings.noise), settings.noise)


def standing_boxes(product: Product, parts: Sequence[tuple[str, Pose]]) -> Boxes:
    """Boxes of parts (type, pose of the part frame), for scenes made elsewhere."""
    return Boxes(
        tuple(name for name, _ in parts),
        np.array([pose.position_m[:2] for _, pose in parts]),
        np.array([pose.yaw_rad for _, pose in parts]),
        np.array([pose.position_m[2] for _, pose in parts]),
        np.array([product.parts[name].size_m for name, _ in parts]),
    )


def observe(boxes: Boxes, rng: np.random.Generator, noise: DetectionNoise) -> tuple[PartDetection, ...]:
    """What the part detector answers about boxes: a long box looks the same turned by half a turn."""
    count = len(boxes)
    centre = boxes.centre_m + rng.normal(0.0, noise.position_m, (count, 2))
    yaw = boxes.yaw_rad + rng.normal(0.0, noise.yaw_rad, count) + math.pi * rng.integers(0, 2, count)
    bottom = boxes.bottom_m + rng.normal(0.0, noise.bottom_m, count)
    size = np.maximum(boxes.size_m + rng.normal(0.0, noise.size_m, (count, 3)), 0.001)
    confidence = rng.uniform(0.7, 1.0, count)
    return tuple(
        PartDetection(
            boxes.types[i],
            float(confidence[i]),
            Pose.from_yaw((centre[i, 0], centre[i, 1], bottom[i]), float(yaw[i])),
            (float(size[i, 0]), float(size[i, 1]), float(size[i, 2])),
            _box_px(centre[i], float(yaw[i]), size[i]),
        )
        for i in range(count)
    )


def data_hash(scenes: Sequence[Scene]) -> str:
    """SHA-256 over truth and detections: the identity of a data set."""
    digest = hashlib.sha256()
    for scene in scenes:
        boxes = scene.boxes
        digest.update(" ".join(boxes.types).encode())
        digest.update(scene.blocks.tobytes())
        truth = [boxes.centre_m.ravel(), boxes.yaw_rad, boxes.bottom_m, boxes.size_m.ravel()]
        seen = [
            (*part.world_from_part.position_m, *_direction(part.world_from_part), *part.size_m, part.confidence)
            for part in scene.parts
        ]
        # Rounded, so that scenes are the same after they were written and read.
        numbers = np.round(np.concatenate([*truth, np.ravel(seen)]) / _HASHED_UNIT)
        digest.update(numbers.astype(np.int64).tobytes())
    return digest.hexdigest()


def _direction(pose: Pose) -> tuple[float, float]:
    return math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)


def _draw_boxes(product: Product, rng: np.random.Generator, settings: SceneSettings, sizes: tuple[int, int]) -> Boxes:
    """Parts placed one after another, most of them near one that stands; starts again where one finds no place."""
    count = int(rng.integers(sizes[0], sizes[1] + 1))
    names = list(product.parts)
    if settings.by_quantity:
        stock = np.repeat(np.arange(len(names)), [product.parts[name].quantity for name in names])
        chosen = rng.permutation(stock)[:count]
    else:
        chosen = rng.integers(0, len(names), count)
    types = [names[i] for i in chosen]
    while True:
        placed: Boxes | None = None
        for name in types:
            placed = _place(placed, name, product, rng, settings)
            if placed is None:
                break
        if placed is not None:
            return placed


def _place(
    placed: Boxes | None, name: str, product: Product, rng: np.random.Generator, settings: SceneSettings
) -> Boxes | None:
    """The boxes with one more, or None where no free place was found."""
    half_tray = np.array(settings.tray_m) / 2
    yaw = rng.uniform(-math.pi, math.pi, _PLACING_TRIES)
    beside = placed is not None and rng.random() < settings.neighbour_share
    if placed is not None and beside:
        tried = _boxes_beside(placed, name, product, yaw, rng, settings)
    else:
        tried = _boxes(name, product, rng.uniform(-half_tray, half_tray, (_PLACING_TRIES, 2)), yaw)
    reach = np.hypot(*product.parts[name].size_m[:2]) / 2
    free = np.all(np.abs(tried.centre_m) + reach <= half_tray, axis=1)
    if placed is not None:
        free &= ~bodies_overlap(placed, tried, settings.nearest_gap_m).any(axis=0)
    places = np.flatnonzero(free)[: settings.crowding if beside else 1]
    if not len(places):
        return None
    if placed is None:
        return tried.take(places.tolist())
    offset = tried.centre_m[places] - placed.centre_m.mean(axis=0)
    nearest = int(places[np.hypot(offset[:, 0], offset[:, 1]).argmin()])
    return _joined(placed, tried.take([nearest]))


def _boxes_beside(
    placed: Boxes, name: str, product: Product, yaw_rad: Array, rng: np.random.Generator, settings: SceneSettings
) -> Boxes:
    """Parts slid away from one that stands, each in a random direction until the gap is as drawn."""
    count = len(yaw_rad)
    neighbours = placed.take(rng.integers(len(placed), size=count).tolist())
    angle = rng.uniform(-math.pi, math.pi, count)
    direction = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    gap = rng.uniform(settings.nearest_gap_m, settings.farthest_gap_m, count)
    boxes = _boxes(name, product, neighbours.centre_m, yaw_rad)
    distance = sliding_distance_m(neighbours, boxes, direction, gap)
    return replace(boxes, centre_m=boxes.centre_m + distance[:, None] * direction)


def _boxes(name: str, product: Product, centre_m: Array, yaw_rad: Array) -> Boxes:
    """Parts of one type at centres (n, 2)."""
    part, count = product.parts[name], len(yaw_rad)
    bottom, size = np.full(count, part.peg_length_m), np.tile(np.array(part.size_m), (count, 1))
    return Boxes((name,) * count, centre_m, yaw_rad, bottom, size)


def _joined(first: Boxes, second: Boxes) -> Boxes:
    return Boxes(
        first.types + second.types,
        np.concatenate([first.centre_m, second.centre_m]),
        np.concatenate([first.yaw_rad, second.yaw_rad]),
        np.concatenate([first.bottom_m, second.bottom_m]),
        np.concatenate([first.size_m, second.size_m]),
    )


def _box_px(centre_m: Array, yaw_rad: float, size_m: Array) -> tuple[int, int, int, int]:
    """Bounding box in a nominal image from straight above, the tray's middle at its origin."""
    cos, sin = abs(math.cos(yaw_rad)), abs(math.sin(yaw_rad))
    half = np.array([cos * size_m[0] + sin * size_m[1], sin * size_m[0] + cos * size_m[1]]) / 2
    left, top = np.floor((centre_m - half) * _PIXELS_PER_M).astype(int)
    right, bottom = np.ceil((centre_m + half) * _PIXELS_PER_M).astype(int)
    return int(left), int(top), int(right), int(bottom)
