"""The paper's grasp planner at run time (section 3.2), and any planner by its kind; no torch."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bracket_cell.learned.grasp.model import PairwisePlanner, RulePlanner, side_by_side
from bracket_cell.learned.grasp.settings import DetectionNoise
from bracket_cell.learned.grasp.solution import Solution
from bracket_cell.learned.inference.onnx_model import Network, OnnxModel
from bracket_ground.errors import ModelError
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.planning import GraspPlan, GraspPlanner
from bracket_ground.interfaces.product import Product
from bracket_lab.learned.grasp.graph import SceneGraph, scene_graph
from bracket_lab.learned.grasp.language import decode, words_of

_BULK = 512  # graphs at once
KINDS = ("pairwise", "paper", "rule")


def load_grasp_planner(kind: str, weights: Path, product: Product, noise: DetectionNoise | None = None) -> GraspPlanner:
    """The planner of a kind, for experiments and trainings; `rule` reads no weights.

    Args:
        noise: of the detections that it will be asked about; the detector's measured one by default.

    Raises:
        ModelError: the weights cannot be used.
    """
    if kind == "rule":
        return RulePlanner(product)
    return PaperPlanner.load(product, weights) if kind == "paper" else PairwisePlanner.load(product, weights, noise)


class PaperPlanner:
    """Scene graph in; graspability and decoded words out (Eq. 4-7).

    Where its network reads embeddings of crops, the detections must have them (learned/grasp/crops.py).
    """

    def __init__(self, network: Network, product: Product) -> None:
        config = network.card.config
        self._network = network
        self._product = product
        self._crops = bool(config["crops"])
        self._known: dict[tuple[int, tuple[int, ...]], _Answer] = {}
        self.plan(side_by_side(product), 0)

    @staticmethod
    def load(product: Product, weights: Path) -> PaperPlanner:
        """With the network of a file.

        Raises:
            ModelError: it is missing or damaged, of another kind, trained for other part types, or cannot answer.
        """
        model = OnnxModel.load(weights, "grasp.paper")
        model.require_vocabulary("parts", tuple(product.parts))
        model.require_vocabulary("words", words_of(tuple(product.parts)))
        return PaperPlanner(model, product)

    def plan(self, parts: tuple[PartDetection, ...], required: int) -> GraspPlan:
        """A plan for `parts[required]`.

        Raises:
            ModelError: detections without embeddings; the network answered NaN or words that are no solution.
        """
        return self.plan_together(parts, (required,))[0]

    def plan_together(self, parts: tuple[PartDetection, ...], required: Sequence[int]) -> tuple[GraspPlan, ...]:
        """Plans for several parts that are required of one graph; raises as `plan`."""
        return tuple(
            self._found(parts, (asked, *(other for other in required if other != asked))) for asked in required
        )

    def prepare(self, questions: Sequence[tuple[tuple[PartDetection, ...], tuple[int, ...]]]) -> None:
        """Work out answers about the first required part of each question in one go, and forget those before."""
        graphs = [self._graph(*question) for question in questions]
        self._known = {}
        for first in range(0, len(graphs), _BULK):
            found = self._network.run(_inputs(graphs[first : first + _BULK]))
            asked = zip(questions[first:], graphs[first:], found["verdict"], found["words"], strict=False)
            for (parts, required), graph, verdict, words in asked:
                answer = _Answer(parts, graph, float(verdict), words.tolist())
                self._known[id(parts), required] = answer

    def _found(self, parts: tuple[PartDetection, ...], required: tuple[int, ...]) -> GraspPlan:
        answer = self._known.get((id(parts), required))
        if answer is None or answer.parts is not parts:
            graph = self._graph(parts, required)
            found = self._network.run(_inputs([graph]))
            answer = _Answer(parts, graph, float(found["verdict"][0]), found["words"][0].tolist())
            self._known = {(id(parts), required): answer}
        graspable = 1.0 / (1.0 + math.exp(-answer.verdict))
        if graspable >= 0.5:
            return Solution().plan(graspable)
        solution = decode(answer.words, answer.graph.boxes, list(self._product.parts), 0)
        moved = tuple(answer.graph.order[index] for index in solution.moves)
        return Solution(moved, solution.needs_help).plan(graspable)

    def _graph(self, parts: tuple[PartDetection, ...], required: tuple[int, ...]) -> SceneGraph:
        if not all(part.upright for part in parts):
            raise ModelError("the paper's planner knows parts that stand, and something lies in the tray")
        return scene_graph(parts, required, self._product, self._crops)


def _inputs(graphs: Sequence[SceneGraph]) -> dict[str, NDArray[Any]]:
    return {name: np.stack([getattr(graph, name) for graph in graphs]) for name in ("nodes", "weights", "present")}


@dataclass(frozen=True)
class _Answer:
    """What the network said about one part of a set of detections.

    Attributes:
        parts: kept, so that no other set has the same identity.
        verdict: logit that the part is graspable.
    """

    parts: tuple[PartDetection, ...]
    graph: SceneGraph
    verdict: float
    words: list[int]
