"""What geometry alone can reach: votes over what the scene may truly be, given its noisy detections.

The reference knows the product's sizes, the noise's standard deviations, the gripper's outline and that bodies do
not overlap. It draws scenes that the detections allow and takes the answer that is right in most of them. It does
not know how parts are strewn, which under much noise tells more than the detections, and it is too slow to plan
with.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cell.interfaces.perception import PartDetection
from cell.interfaces.planning import GraspPlan
from cell.interfaces.pose import Array
from cell.interfaces.product import Product
from learned.grasp.boxes import Blocks, Boxes, boxes_of, rectangles_overlap
from learned.grasp.candidates import graspable
from learned.grasp.pairs import as_in_catalogue
from learned.grasp.physics import touching
from learned.grasp.settings import DetectionNoise, GripperOutline
from learned.grasp.solution import Solution, nearest_first, solve, solves

_TRIES_FOR_EACH = 8  # draws for each scene that is kept, the most possible ones


class AveragingPlanner:
    """A Monte Carlo average over the known noise."""

    def __init__(self, product: Product, noise: DetectionNoise, draws: int = 40, nearest_gap_m: float = 0.003) -> None:
        self._product = product
        self._noise = noise
        self._draws = draws
        self._gap_m = nearest_gap_m
        self._outline = GripperOutline()
        self._seen: tuple[PartDetection, ...] | None = None
        self._possible: list[Blocks] = []

    def plan(self, parts: tuple[PartDetection, ...], required: int) -> GraspPlan:
        """The answer that is right in most of the scenes that the detections allow."""
        boxes = as_in_catalogue(boxes_of(parts, self._product), self._product)
        if self._seen is not parts:
            self._seen, self._possible = parts, self._draw(boxes)
        order = nearest_first(boxes, required)
        solutions = Counter(solve(blocks, required, order) for blocks in self._possible)
        best = max(solutions, key=lambda solution: _votes(solution, self._possible, required))
        share = np.mean([graspable(blocks)[required] for blocks in self._possible])
        return best.plan(float(share))

    def _draw(self, boxes: Boxes) -> list[Blocks]:
        rng = np.random.default_rng(len(boxes))
        noise, count = self._noise, len(boxes)
        drawn = [
            replace(
                boxes,
                centre_m=boxes.centre_m + rng.normal(0.0, noise.position_m, (count, 2)),
                yaw_rad=boxes.yaw_rad + rng.normal(0.0, noise.yaw_rad, count),
            )
            for _ in range(_TRIES_FOR_EACH * self._draws)
        ]
        overlaps = _overlaps(drawn, self._gap_m)
        return [touching(drawn[k], self._outline) for k in np.argsort(overlaps, kind="stable")[: self._draws]]


def _overlaps(drawn: Sequence[Boxes], gap_m: float) -> Array:
    """(draws,) how many bodies come nearer to each other than a gap; all draws have the same bodies."""
    centre = np.stack([boxes.centre_m for boxes in drawn])
    yaw = np.stack([boxes.yaw_rad for boxes in drawn])
    half = drawn[0].size_m[:, :2] / 2
    overlap = rectangles_overlap(
        centre[:, :, None], yaw[:, :, None], half[:, None] + gap_m, centre[:, None], yaw[:, None], half
    )
    found: Array = overlap.sum(axis=(1, 2))
    return found


def _votes(solution: Solution, possible: Sequence[Blocks], required: int) -> int:
    if solution.needs_help:
        return sum(solve(blocks, required, range(len(blocks))).needs_help for blocks in possible)
    return sum(solves(solution.moves, blocks, required) for blocks in possible)
