"""GVMRN-RF for comparison: a graph over pairs of parts whose nodes say which part is in the way of which.

After "Graph-based visual manipulation relationship reasoning" (Zuo et al.): nodes are the union boxes of ordered
pairs, a graph convolution runs between pairs that share a part, and a relation filter drops pairs whose boxes in the
image do not meet, or in a second reading those that are too far apart. The images' features are replaced by what the
detector gives. A relation is predicted for each way to grasp the first part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import Field
from torch import Tensor, nn

from bracket_cell.learned.grasp.boxes import Blocks, Boxes, boxes_of
from bracket_cell.learned.grasp.candidates import CANDIDATES, as_headed, available, graspable, mark_missing
from bracket_cell.learned.grasp.settings import GripperOutline, TrainingSettings
from bracket_cell.learned.grasp.solution import nearest_first, solve
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.planning import GraspPlan
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.product import Product
from bracket_lab.learned.grasp.scenes import Scene

RelationFilter = Literal["boxes", "distance"]
RELATION_FILTER_M = 0.12  # centres of parts that can matter to each other
_UNIT_M = 0.05
_GEOMETRY = 15


class RelationSettings(TrainingSettings):
    """GVMRN-RF, the pairwise relations of Table 2.

    Attributes:
        filter: which pairs have a relation: those whose boxes in the image meet, as in its paper, or near ones.
    """

    scenes: int = Field(default=427, gt=0)
    epochs: int = Field(default=60, gt=0)
    batch: int = Field(default=64, gt=0)
    peak_rate: float = Field(default=0.004, gt=0)
    hidden: int = Field(default=96, gt=0)
    filter: RelationFilter = "boxes"


@dataclass(frozen=True, eq=False)
class PairGraph:
    """Ordered pairs of one scene.

    Attributes:
        first, second: (p,) the parts of each pair.
        nodes: (p, features).
        links: (p, p) normalised adjacency of pairs that share a part.
    """

    first: NDArray[np.intp]
    second: NDArray[np.intp]
    nodes: NDArray[np.float32]
    links: NDArray[np.float32]


def pair_graph(parts: Sequence[PartDetection], product: Product, by: RelationFilter = "boxes") -> PairGraph:
    """The pairs that pass the relation filter."""
    boxes = boxes_of(parts, product)
    near = _boxes_meet(parts) if by == "boxes" else _are_near(boxes)
    np.fill_diagonal(near, False)
    first, second = np.nonzero(near)
    linked = (first[:, None] == first) | (first[:, None] == second) | (second[:, None] == first)
    linked |= second[:, None] == second
    degree = np.sqrt(np.maximum(linked.sum(axis=1), 1))
    links = (linked / degree[:, None] / degree).astype(np.float32)
    return PairGraph(first, second, _node_features(boxes, first, second, list(product.parts)), links)


def _boxes_meet(parts: Sequence[PartDetection]) -> Blocks:
    """(n, n) whether the upright boxes that the detector drew share a pixel."""
    corners = np.array([part.box_px for part in parts])
    low, high = corners[:, :2], corners[:, 2:]
    meet: Blocks = (np.maximum(low[:, None], low) < np.minimum(high[:, None], high)).all(axis=-1)
    return meet


def _are_near(boxes: Boxes) -> Blocks:
    """(n, n) whether the centres are near each other."""
    between = boxes.centre_m[None] - boxes.centre_m[:, None]
    near: Blocks = np.hypot(between[..., 0], between[..., 1]) < RELATION_FILTER_M
    return near


def relation_features(product: Product) -> int:
    """Width of the nodes."""
    return 2 * len(product.parts) + _GEOMETRY


def _node_features(
    boxes: Boxes, first: NDArray[np.intp], second: NDArray[np.intp], names: list[str]
) -> NDArray[np.float32]:
    kinds = np.eye(len(names))[[names.index(name) for name in boxes.types]]
    yaw, turn = boxes.yaw_rad[first], boxes.yaw_rad[second] - boxes.yaw_rad[first]
    offset = boxes.centre_m[second] - boxes.centre_m[first]
    cos, sin = np.cos(yaw), np.sin(yaw)
    half = _upright_half_m(boxes)
    met = np.maximum(half[first] + half[second] - np.abs(offset), 0.0).prod(axis=1)
    union = np.maximum(half[first], offset + half[second]) - np.minimum(-half[first], offset - half[second])
    lengths = np.column_stack(
        [
            offset[:, 0] * cos + offset[:, 1] * sin,
            offset[:, 1] * cos - offset[:, 0] * sin,
            np.hypot(offset[:, 0], offset[:, 1]),
            boxes.size_m[first],
            boxes.size_m[second],
            boxes.top_m[second] - boxes.top_m[first],
            union,
        ]
    )
    angles = [np.cos(2 * turn), np.sin(2 * turn), met / _UNIT_M**2]
    return np.column_stack([kinds[first], kinds[second], lengths / _UNIT_M, *angles]).astype(np.float32)


def _upright_half_m(boxes: Boxes) -> Array:
    """(n, 2) half sides of the boxes that an image detector draws around the bodies."""
    cos, sin = np.abs(np.cos(boxes.yaw_rad)), np.abs(np.sin(boxes.yaw_rad))
    length, width = boxes.size_m[:, 0], boxes.size_m[:, 1]
    half: Array = np.stack([length * cos + width * sin, length * sin + width * cos], axis=1) / 2
    return half


class RelationNet(nn.Module):
    """Two graph convolutions over pairs, then a logit for each candidate of the first part."""

    def __init__(self, features: int, hidden: int) -> None:
        super().__init__()
        self.enter = nn.Linear(features, hidden)
        self.convolutions = nn.ModuleList(nn.Linear(hidden, hidden) for _ in range(2))
        self.leave = nn.Linear(2 * hidden, len(CANDIDATES))

    def forward(self, nodes: Tensor, links: Tensor) -> Tensor:
        """Logits (..., p, candidates) that the second part blocks the first."""
        entered = torch.relu(self.enter(nodes))
        x = entered
        for convolution in self.convolutions:
            x = torch.relu(convolution(links @ x))
        logits: Tensor = self.leave(torch.cat([entered, x], dim=-1))
        return logits


@dataclass(frozen=True)
class RelationData:
    """Scenes padded to the most pairs p.

    Attributes:
        nodes: (scenes, p, features).
        links: (scenes, p, p).
        blocks, known: (scenes, p, candidates) the label, and 1 where there are such a pair and such a candidate.
    """

    nodes: Tensor
    links: Tensor
    blocks: Tensor
    known: Tensor

    def __len__(self) -> int:
        return len(self.nodes)

    def loss(self, net: RelationNet, chosen: Tensor) -> Tensor:
        """Cross-entropy of every relation."""
        logits, known = net(self.nodes[chosen], self.links[chosen]), self.known[chosen]
        each = nn.functional.binary_cross_entropy_with_logits(logits, self.blocks[chosen], reduction="none")
        return (each * known).sum() / known.sum().clamp(min=1.0)


def relation_data(scenes: Sequence[Scene], product: Product, by: RelationFilter = "boxes") -> RelationData:
    """Pairs from the detections, labels from the truth."""
    graphs = [pair_graph(scene.parts, product, by) for scene in scenes]
    most = max(len(graph.first) for graph in graphs)
    nodes = np.zeros((len(graphs), most, relation_features(product)), dtype=np.float32)
    links = np.zeros((len(graphs), most, most), dtype=np.float32)
    blocks, known = np.zeros((2, len(graphs), most, len(CANDIDATES)), dtype=np.float32)
    for k, (scene, graph) in enumerate(zip(scenes, graphs, strict=True)):
        count = len(graph.first)
        nodes[k, :count], links[k, :count, :count] = graph.nodes, graph.links
        truth = as_headed(scene.blocks, scene.boxes, boxes_of(scene.parts, product))
        blocks[k, :count] = truth[graph.first, :, graph.second]
        known[k, :count] = ~truth[graph.first, :, graph.first]
    return RelationData(*(torch.from_numpy(values) for values in (nodes, links, blocks, known)))


def untrained_relations(
    scenes: Sequence[Scene], product: Product, settings: RelationSettings
) -> tuple[RelationNet, RelationData]:
    """A new network, and what it is to learn."""
    return RelationNet(relation_features(product), settings.hidden), relation_data(scenes, product, settings.filter)


class RelationPlanner:
    """GVMRN-RF: relations of pairs, and from them the moves."""

    def __init__(
        self, net: RelationNet, product: Product, by: RelationFilter = "boxes", outline: GripperOutline | None = None
    ) -> None:
        self._net, self._by, self._outline = net, by, outline or GripperOutline()
        self._product = product

    def plan(self, parts: tuple[PartDetection, ...], required: int) -> GraspPlan:
        """A plan for `parts[required]`."""
        boxes = boxes_of(parts, self._product)
        graph = pair_graph(parts, self._product, self._by)
        exists = available(boxes, self._outline)
        blocks = np.zeros((*exists.shape, len(boxes)), dtype=bool)
        with torch.no_grad():
            logits = self._net(torch.from_numpy(graph.nodes), torch.from_numpy(graph.links)).numpy()
        blocks[graph.first, :, graph.second] = logits > 0
        blocks = mark_missing(blocks, exists)
        solution = solve(blocks, required, nearest_first(boxes, required))
        return solution.plan(1.0 if graspable(blocks)[required] else 0.0)
