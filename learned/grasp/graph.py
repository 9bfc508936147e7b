"""The scene graph: detections as nodes, a goal flag on the required one, weighted edges (section 3.2, Eq. 4)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cell.interfaces.perception import PartDetection
from cell.interfaces.pose import Array
from cell.interfaces.product import Product
from learned.grasp.boxes import boxes_of
from learned.grasp.crops import CROP_FEATURES, crop_signs
from learned.grasp.solution import nearest_first

MAX_PARTS = 8  # what does not fit is farthest from the required part
UNIT_M = 0.05  # lengths in the graph are multiples of this, so that features are near 1
EdgeKind = Literal["printed", "normalised", "none", "gcn"]
Attention = Literal["printed", "additive", "none"]
_GEOMETRY = 10


@dataclass(frozen=True)
class SceneGraph:
    """One required part among its neighbours, padded to MAX_PARTS nodes.

    Node 0 is the required part, the others follow by distance; so the graph is the same whatever the order of the
    detections.

    Attributes:
        nodes: (MAX_PARTS, features).
        weights: (MAX_PARTS, MAX_PARTS) e_ij of Eq. 4, 0 on the diagonal and where there is no node.
        present: (MAX_PARTS,) 1 where there is a node.
        order: index of the detection behind each node.
    """

    nodes: NDArray[np.float32]
    weights: NDArray[np.float32]
    present: NDArray[np.float32]
    order: tuple[int, ...]


def feature_count(product: Product, crops: bool = False) -> int:
    """Width of the node features, with or without the embeddings of crops."""
    return len(product.parts) + _GEOMETRY + MAX_PARTS + (CROP_FEATURES if crops else 0)


def mirror_signs(product: Product, crops: bool = False) -> NDArray[np.float32]:
    """Signs (4, features) that turn nodes into those of the scene mirrored at the required part's axes."""
    signs = np.ones((4, feature_count(product, crops)), dtype=np.float32)
    along, across, sine = (len(product.parts) + offset for offset in (1, 2, 4))
    signs[1, [along, sine]] = signs[2, [across, sine]] = signs[3, [along, across]] = -1.0
    if crops:
        signs[:, -CROP_FEATURES:] = crop_signs()
    return signs


def scene_graph(
    parts: Sequence[PartDetection],
    required: int,
    product: Product,
    edges: EdgeKind,
    filter_m: float | None = None,
    crops: bool = False,
) -> SceneGraph:
    """The graph of all detections for one required part.

    Args:
        filter_m: parts farther from each other have no edge.
        crops: nodes hold the detections' embeddings, too.
    """
    boxes = boxes_of(parts, product)
    order = nearest_first(boxes, required)[:MAX_PARTS]
    near = boxes.take(order)
    count = len(order)
    offset = near.centre_m - near.centre_m[0]
    cos, sin = np.cos(near.yaw_rad[0]), np.sin(near.yaw_rad[0])
    turn = near.yaw_rad - near.yaw_rad[0]
    names = list(product.parts)
    nodes = np.zeros((MAX_PARTS, feature_count(product, crops)), dtype=np.float32)
    nodes[:count] = np.concatenate(
        [
            np.eye(len(names))[[names.index(name) for name in near.types]],
            np.eye(count, 1),  # goal flag
            offset @ np.array([[cos, -sin], [sin, cos]]) / UNIT_M,
            np.stack([np.cos(2 * turn), np.sin(2 * turn)], axis=1),
            near.size_m / UNIT_M,
            (near.bottom_m - near.bottom_m[0])[:, None] / UNIT_M,
            np.array([[parts[i].confidence] for i in order]),
            np.eye(count, MAX_PARTS),  # its letter
            *([np.array([parts[i].embedding for i in order])] if crops else []),
        ],
        axis=1,
    )
    weights = np.zeros((MAX_PARTS, MAX_PARTS), dtype=np.float32)
    weights[:count, :count] = edge_weights(
        near.centre_m / UNIT_M, edges, None if filter_m is None else filter_m / UNIT_M
    )
    present = (np.arange(MAX_PARTS) < count).astype(np.float32)
    return SceneGraph(nodes, weights, present, tuple(order))


def edge_weights(centres: Array, edges: EdgeKind, farthest: float | None = None) -> Array:
    """e_ij (n, n) between nodes at centres (n, 2); 0 beyond the farthest and, but for "gcn", on the diagonal."""
    between = centres[None] - centres[:, None]
    distance = np.hypot(between[..., 0], between[..., 1])
    closeness = 1.0 / np.maximum(distance, 1e-3)
    np.fill_diagonal(closeness, 0.0)
    if farthest is not None:
        closeness[distance > farthest] = 0.0
    total = np.maximum(closeness.sum(axis=1, keepdims=True), 1e-9)
    return _EDGE_WEIGHTS[edges](closeness, total)


def _printed(closeness: Array, total: Array) -> Array:
    """Eq. 4 as printed: the same for every j, it says how isolated i is."""
    weights: Array = np.where(closeness > 0, 1.0 / total, 0.0)
    return weights


def _normalised(closeness: Array, total: Array) -> Array:
    """The reading that weights neighbours: e_ij = (1 / d_ij) / sum_k (1 / d_ik)."""
    weights: Array = closeness / total
    return weights


def _none(closeness: Array, total: Array) -> Array:  # noqa: ARG001
    """All neighbours count alike."""
    weights: Array = (closeness > 0).astype(np.float64)
    return weights


def _gcn(closeness: Array, total: Array) -> Array:  # noqa: ARG001
    """D^-1/2 (A + I) D^-1/2 of the graph convolution by Kipf and Welling."""
    linked = (closeness > 0) + np.eye(len(closeness))
    degree = np.sqrt(linked.sum(axis=1))
    weights: Array = linked / degree[:, None] / degree
    return weights


_EDGE_WEIGHTS: dict[EdgeKind, Callable[[Array, Array], Array]] = {
    "printed": _printed,
    "normalised": _normalised,
    "none": _none,
    "gcn": _gcn,
}
