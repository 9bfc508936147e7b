"""Grasp planners at run time: weights by onnxruntime, plans through one interface (section 3.2)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cell.interfaces.errors import ModelError
from cell.interfaces.perception import PartDetection
from cell.interfaces.planning import GraspPlan, GraspPlanner
from cell.interfaces.pose import Array
from cell.interfaces.product import Product
from learned.grasp.geometry import Boxes, boxes_of
from learned.grasp.pairs import near_pairs, pair_features
from learned.grasp.rule import RulePlanner
from learned.grasp.solution import nearest_first, solve
from learned.onnx_model import OnnxModel

KINDS = ("pairwise", "paper", "rule")


def load_grasp_planner(kind: str, path: Path, product: Product) -> GraspPlanner:
    """The planner of a kind; `rule` reads no weights.

    Raises:
        ModelError: the weights are missing or damaged, or were trained for other part types.
    """
    if kind == "rule":
        return RulePlanner(product)
    if kind == "pairwise":
        return PairwisePlanner(OnnxModel.load(path, "grasp.pairwise"), product)
    raise ModelError(f"unknown grasp planner {kind!r}; known: {', '.join(KINDS)}")


class PairwisePlanner:
    """Asks a network of every pair of neighbours whether one blocks the other; who blocks none decides the rest."""

    def __init__(self, model: OnnxModel, product: Product) -> None:
        model.require_vocabulary("parts", tuple(product.parts))
        self._model = model
        self._product = product

    def plan(self, parts: tuple[PartDetection, ...], required: int) -> GraspPlan:
        """A plan for `parts[required]`; graspable is the noisy-or of all its possible blockers."""
        boxes = boxes_of(parts, self._product)
        chance = self._blocking_chance(boxes)
        free = np.prod(1.0 - chance, axis=1)
        blocks = chance >= 0.5
        # Several doubtful blockers can add up to a blocked part: then the likeliest one is named.
        doubtful = np.flatnonzero((free < 0.5) & ~blocks.any(axis=1))
        blocks[doubtful, chance[doubtful].argmax(axis=1)] = True
        return solve(blocks, required, nearest_first(boxes, required)).plan(float(free[required]))

    def _blocking_chance(self, boxes: Boxes) -> Array:
        """(n, n): probability that the second blocks the first."""
        chance = np.zeros((len(boxes), len(boxes)))
        required, neighbour = near_pairs(boxes)
        if len(required):
            logits = self._model.run({"pairs": pair_features(boxes, required, neighbour)})["logits"]
            chance[required, neighbour] = 1.0 / (1.0 + np.exp(-logits.astype(np.float64)))
        return chance
