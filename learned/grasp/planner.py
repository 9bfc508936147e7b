"""Grasp planners at run time: weights by onnxruntime, plans through one interface (section 3.2)."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from cell.interfaces.errors import ModelError
from cell.interfaces.perception import PartDetection
from cell.interfaces.planning import GraspPlan, GraspPlanner
from cell.interfaces.pose import Array, Pose
from cell.interfaces.product import Product
from learned.grasp.boxes import Boxes, boxes_of
from learned.grasp.graph import EdgeKind, SceneGraph, scene_graph
from learned.grasp.language import WORDS, decode
from learned.grasp.options import available, mark_missing
from learned.grasp.pairs import near_pairs, pair_features
from learned.grasp.rule import RulePlanner
from learned.grasp.settings import GripperOutline
from learned.grasp.solution import Solution, nearest_first, solve
from learned.onnx_model import OnnxModel

KINDS = ("pairwise", "paper", "rule")


def load_grasp_planner(kind: str, path: Path, product: Product) -> GraspPlanner:
    """The planner of a kind; `rule` reads no weights.

    Raises:
        ModelError: the weights are missing or damaged, were trained for other part types, or cannot answer at all.
    """
    if kind not in KINDS:
        raise ModelError(f"unknown grasp planner {kind!r}; known: {', '.join(KINDS)}")
    if kind == "rule":
        return RulePlanner(product)
    if kind == "pairwise":
        return PairwisePlanner(OnnxModel.load(path, "grasp.pairwise"), product)
    return PaperPlanner(OnnxModel.load(path, "grasp.paper"), product)


def _side_by_side(product: Product) -> tuple[PartDetection, ...]:
    """Two parts close together: weights that do not fit the features fail on them, before anything moves."""
    name, kind = next(iter(product.parts.items()))
    poses = (Pose((0.0, 0.0, 0.0)), Pose((0.0, kind.size_m[1] + 0.01, 0.0)))
    return tuple(PartDetection(name, 1.0, pose, kind.size_m, (0, 0, 1, 1)) for pose in poses)


class PairwisePlanner:
    """Asks a network of each pair of neighbours whether one blocks the other, and works out the moves from that."""

    def __init__(self, model: OnnxModel, product: Product) -> None:
        model.require_vocabulary("parts", tuple(product.parts))
        self._model = model
        self._product = product
        self._blocking_chance(boxes_of(_side_by_side(product), product))

    def plan(self, parts: tuple[PartDetection, ...], required: int) -> GraspPlan:
        """A plan for `parts[required]`; an option is free by the noisy-or of all its possible blockers."""
        boxes = boxes_of(parts, self._product)
        chance = self._blocking_chance(boxes)
        free = np.prod(1.0 - chance, axis=-1)
        blocks = chance >= 0.5
        # Several doubtful blockers can add up to a blocked option: then the likeliest one is named.
        doubtful = np.nonzero((free < 0.5) & ~blocks.any(axis=-1))
        blocks[(*doubtful, chance[doubtful].argmax(axis=-1))] = True
        return solve(blocks, required, nearest_first(boxes, required)).plan(float(free[required].max()))

    def _blocking_chance(self, boxes: Boxes) -> Array:
        """(n, options, n): probability that j blocks an option of i; 1 for i itself where it has no such option."""
        exists = available(boxes, GripperOutline())
        chance = mark_missing(np.zeros((*exists.shape, len(boxes)), dtype=bool), exists).astype(np.float64)
        pairs = near_pairs(boxes)
        if len(pairs):
            logits = self._model.run({"pairs": pair_features(boxes, pairs)})["logits"]
            chance[pairs.part, pairs.option, pairs.neighbour] = 1.0 / (1.0 + np.exp(-logits.astype(np.float64)))
        return chance


class PaperPlanner:
    """Scene graph in; graspability and decoded words out (Eq. 4-7)."""

    def __init__(self, model: OnnxModel, product: Product) -> None:
        model.require_vocabulary("parts", tuple(product.parts))
        model.require_vocabulary("words", WORDS)
        self._model = model
        self._product = product
        self._edges = cast(EdgeKind, model.card.config["edges"])
        self._answer(scene_graph(_side_by_side(product), 0, product, self._edges))

    def plan(self, parts: tuple[PartDetection, ...], required: int) -> GraspPlan:
        """A plan for `parts[required]`.

        Raises:
            ModelError: the network answered NaN or words that are no solution.
        """
        graph = scene_graph(parts, required, self._product, self._edges)
        answer = self._answer(graph)
        graspable = 1.0 / (1.0 + math.exp(-float(answer["verdict"][0])))
        if graspable >= 0.5:
            return Solution().plan(graspable)
        return decode([int(word) for word in answer["words"][0]], graph.order).plan(graspable)

    def _answer(self, graph: SceneGraph) -> dict[str, NDArray[Any]]:
        """Verdict and words of the network."""
        return self._model.run(
            {"nodes": graph.nodes[None], "weights": graph.weights[None], "present": graph.present[None]}
        )
