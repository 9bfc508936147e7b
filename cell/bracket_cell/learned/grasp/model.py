"""Grasp planners at run time: weights by onnxruntime, plans through one interface (section 3.2)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bracket_cell.learned.grasp.boxes import Blocks, Boxes, boxes_of
from bracket_cell.learned.grasp.candidates import available, fixed, graspable, middle_alone, touching
from bracket_cell.learned.grasp.crops import EMBEDDING
from bracket_cell.learned.grasp.pairs import near_pairs, pair_features
from bracket_cell.learned.grasp.settings import WITH_MARGINS, DetectionNoise, GripperOutline, outline_of
from bracket_cell.learned.grasp.solution import nearest_first, solve
from bracket_cell.learned.inference.onnx_model import Network, OnnxModel
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.planning import GraspPlan
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import Product
from bracket_ground.interfaces.robot import RobotModel


class RulePlanner:
    """Needs no weights; trusts every detection as if it were exact. What does not stand is only in the way."""

    def __init__(self, product: Product, outline: GripperOutline = WITH_MARGINS) -> None:
        self._product = product
        self._outline = outline.model_copy(update={"middle_alone": middle_alone(product, outline)})

    def plan(self, parts: tuple[PartDetection, ...], required: int) -> GraspPlan:
        """A plan for `parts[required]`."""
        boxes = boxes_of(parts, self._product)
        blocks = fixed(touching(boxes, self._outline), parts)
        solution = solve(blocks, required, nearest_first(boxes, required))
        return solution.plan(1.0 if graspable(blocks)[required] else 0.0)


def side_by_side(product: Product) -> tuple[PartDetection, ...]:
    """Two parts close together: weights that do not fit the features fail on them, before anything moves."""
    name, kind = next(iter(product.parts.items()))
    poses = (Pose((0.0, 0.0, 0.0)), Pose((0.0, kind.size_m[1] + 0.01, 0.0)))
    crop = (0.0,) * EMBEDDING
    return tuple(PartDetection(name, 1.0, pose, kind.size_m, (0, 0, 1, 1), crop) for pose in poses)


class PairwisePlanner:
    """Asks a network of each pair of neighbours whether one blocks the other, and works out the moves from that."""

    def __init__(
        self,
        network: Network,
        product: Product,
        noise: DetectionNoise | None = None,
        outline: GripperOutline | None = None,
    ) -> None:
        """Args:
        noise: of the detections that it will be asked about; the detector's measured one by default.
        outline: of the gripper; it says which ways to grasp there are.
        """
        outline = outline or GripperOutline()
        self._network = network
        self._outline = outline.model_copy(update={"middle_alone": middle_alone(product, outline)})
        self._product = product
        self._noise = noise or DetectionNoise()
        self._view = self._judge(side_by_side(product))

    @staticmethod
    def load(
        product: Product, weights: Path, noise: DetectionNoise | None = None, robot: RobotModel | None = None
    ) -> PairwisePlanner | RulePlanner:
        """With the network of a file, which knows sizes, not names; the rule for a gripper of other shapes than its.

        Raises:
            ModelError: it is missing or damaged, of another kind, or cannot answer at all.
        """
        if robot is not None and outline_of(robot.gripper) != GripperOutline():
            return RulePlanner(product, outline_of(robot.gripper, margins=True))
        return PairwisePlanner(OnnxModel.load(weights, "grasp.pairwise"), product, noise)

    def plan(self, parts: tuple[PartDetection, ...], required: int) -> GraspPlan:
        """A plan for `parts[required]`; plans for further parts of the same view cost little."""
        if self._view.parts is not parts:
            self._view = self._judge(parts)
        view = self._view
        return solve(view.blocks, required, nearest_first(view.boxes, required)).plan(float(view.free[required]))

    def _judge(self, parts: tuple[PartDetection, ...]) -> _View:
        """Who blocks whom; a candidate is free by the noisy-or of all its possible blockers."""
        boxes = boxes_of(parts, self._product)
        standing = [number for number, part in enumerate(parts) if part.upright]
        chance = self._blocking_chance(boxes.take(standing))
        if len(standing) < len(parts):
            chance = self._among_obstacles(parts, boxes, standing, chance)
        free = np.prod(1.0 - chance, axis=-1)
        blocks = chance >= 0.5
        # Several doubtful blockers can add up to a blocked candidate: then the likeliest one is named.
        doubtful = np.nonzero((free < 0.5) & ~blocks.any(axis=-1))
        blocks[(*doubtful, chance[doubtful].argmax(axis=-1))] = True
        return _View(parts, boxes, blocks, free.max(axis=-1))

    def _among_obstacles(
        self, parts: tuple[PartDetection, ...], boxes: Boxes, standing: list[int], chance: Array
    ) -> Array:
        """The chances of all, where what does not stand is in the way by geometry, and cannot be grasped."""
        margins = self._outline.model_copy(update=WITH_MARGINS.model_dump(exclude={"one_way", "middle_alone"}))
        every: Array = fixed(touching(boxes, margins), parts).astype(float)
        part, candidate, neighbour = np.ix_(standing, range(every.shape[1]), standing)
        every[part, candidate, neighbour] = chance
        return every

    def _blocking_chance(self, boxes: Boxes) -> Array:
        """(n, candidates, n): probability that j blocks a candidate of i; 1 for i itself where there is none."""
        exists = available(boxes, self._outline)
        chance = np.zeros((*exists.shape, len(boxes)))
        part, candidate = np.nonzero(~exists)
        chance[part, candidate, part] = 1.0
        pairs = near_pairs(boxes, exists)
        if len(pairs):
            logits = self._network.run({"pairs": pair_features(boxes, pairs, self._product, self._noise)})["logits"]
            chance[pairs.part, pairs.candidate, pairs.neighbour] = 1.0 / (1.0 + np.exp(-logits.astype(np.float64)))
        return chance


@dataclass(frozen=True, eq=False)
class _View:
    """What was worked out about one set of detections.

    Attributes:
        blocks: (n, candidates, n), as in `solve`.
        free: (n,) probability that the part's best candidate is free.
    """

    parts: tuple[PartDetection, ...]
    boxes: Boxes
    blocks: Blocks
    free: Array
