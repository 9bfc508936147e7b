"""The scene graph: v_i = {f_i, l_i, g_i} of every detection, weighted edges between them (section 3.2, Eq. 4)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bracket_cell.learned.grasp.boxes import Boxes, boxes_of
from bracket_cell.learned.grasp.crops import EMBEDDING
from bracket_cell.learned.grasp.solution import nearest_first
from bracket_ground.errors import ModelError
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.product import Product

MAX_PARTS = 8  # what does not fit is farthest from the required part
UNIT_M = 0.05  # lengths in the graph are multiples of this, so that features are near 1
POSE = 4  # x and y in the scene, cosine and sine of twice the heading


@dataclass(frozen=True, eq=False)
class SceneGraph:
    """A tray with one or more required parts, padded to MAX_PARTS nodes.

    Node 0 is the part that is asked about, the others follow by distance. Their order means nothing to the network.

    Attributes:
        nodes: (MAX_PARTS, features): type l_i, flag g_i, pose, and, where there is one, the embedding f_i.
        weights: (MAX_PARTS, MAX_PARTS) e_ij of Eq. 4, 0 on the diagonal and where there is no node.
        present: (MAX_PARTS,) 1 where there is a node.
        order: index of the detection behind each node.
        boxes: of the nodes that are there.
    """

    nodes: NDArray[np.float32]
    weights: NDArray[np.float32]
    present: NDArray[np.float32]
    order: tuple[int, ...]
    boxes: Boxes


def feature_count(product: Product, crops: bool = False) -> int:
    """Width of the node features, with or without the embeddings of crops."""
    return len(product.parts) + 1 + POSE + (EMBEDDING if crops else 0)


def scene_graph(
    parts: Sequence[PartDetection], required: Sequence[int], product: Product, crops: bool = False
) -> SceneGraph:
    """The graph of all detections; every required part has its flag.

    Args:
        required: the first of them is asked about.
        crops: nodes hold the detections' embeddings, too.

    Raises:
        ModelError: an embedding is wanted and missing.
    """
    boxes = boxes_of(parts, product)
    order = nearest_first(boxes, required[0])[:MAX_PARTS]
    near = boxes.take(order)
    centre, turn = near.centre_m / UNIT_M, 2 * near.yaw_rad
    count, names = len(order), list(product.parts)
    nodes = np.zeros((MAX_PARTS, feature_count(product, crops)), dtype=np.float32)
    kinds = len(names)
    nodes[np.arange(count), [names.index(name) for name in near.types]] = 1.0
    nodes[:count, kinds] = [i in required for i in order]
    nodes[:count, kinds + 1 : kinds + 3] = centre - centre.mean(axis=0)
    nodes[:count, kinds + 3], nodes[:count, kinds + 4] = np.cos(turn), np.sin(turn)
    if crops:
        if any(len(parts[i].embedding) != EMBEDDING for i in order):
            raise ModelError(f"the detections have no embeddings of {EMBEDDING} features of their crops")
        nodes[:count, kinds + 1 + POSE :] = [parts[i].embedding for i in order]
    weights = np.zeros((MAX_PARTS, MAX_PARTS), dtype=np.float32)
    weights[:count, :count] = edge_weights(centre)
    present = (np.arange(MAX_PARTS) < count).astype(np.float32)
    return SceneGraph(nodes, weights, present, tuple(order), near)


def edge_weights(centres: Array) -> Array:
    """e_ij (n, n) between nodes at centres (n, 2), 0 on the diagonal: (1 / d_ij) / sum_k (1 / d_ik).

    Eq. 4 as printed is the same for every j; this reading weights neighbours.
    """
    between = centres[None] - centres[:, None]
    closeness = 1.0 / np.maximum(np.hypot(between[..., 0], between[..., 1]), 1e-3)
    np.fill_diagonal(closeness, 0.0)
    weights: Array = closeness / np.maximum(closeness.sum(axis=1, keepdims=True), 1e-9)
    return weights
