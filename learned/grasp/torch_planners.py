"""Planners on torch networks, for experiments: the same decisions as at run time, without a detour through ONNX."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from cell.interfaces.perception import PartDetection
from cell.interfaces.planning import GraspPlan
from cell.interfaces.product import Product
from learned.grasp.boxes import boxes_of
from learned.grasp.graph import SceneGraph
from learned.grasp.options import available, graspable, mark_missing
from learned.grasp.planner import PaperPlanner
from learned.grasp.relations import RelationNet, pair_graph
from learned.grasp.settings import GripperOutline
from learned.grasp.solution import nearest_first, solve

_BULK = 512  # graphs
_Answered = tuple[SceneGraph, dict[str, NDArray[Any]]]


class TorchNetwork:
    """Runs like an OnnxModel; inputs in the order of the network's arguments."""

    def __init__(self, net: nn.Module, outputs: tuple[str, ...]) -> None:
        self._net = net
        self._outputs = outputs

    def run(self, inputs: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
        """Outputs by name."""
        with torch.no_grad():
            found = self._net(*(torch.from_numpy(values) for values in inputs.values()))
        values = found if isinstance(found, tuple) else (found,)
        return {name: value.numpy() for name, value in zip(self._outputs, values, strict=True)}


class PaperInBulk(PaperPlanner):
    """The paper's planner, which can be asked about many scenes at once beforehand."""

    _views: Sequence[tuple[PartDetection, ...]] = ()
    _known: Mapping[tuple[int, int], _Answered] = MappingProxyType({})

    def prepare(self, views: Sequence[tuple[PartDetection, ...]]) -> None:
        """Answer every question about these views now; `plan` then only looks the answers up."""
        self._views = views  # kept, so that the identities below stay theirs
        asked = [(id(parts), required) for parts in views for required in range(len(parts))]
        graphs = [self._graph(parts, required) for parts in views for required in range(len(parts))]
        answered: dict[tuple[int, int], _Answered] = {}
        for first in range(0, len(asked), _BULK):
            some = graphs[first : first + _BULK]
            found = self._network.run(
                {name: np.stack([getattr(graph, name) for graph in some]) for name in ("nodes", "weights", "present")}
            )
            for k, graph in enumerate(some):
                own = {name: values[k : k + 1] for name, values in found.items()}
                answered[asked[first + k]] = graph, own
        self._known = answered

    def plan(self, parts: tuple[PartDetection, ...], required: int) -> GraspPlan:
        """As prepared, or worked out now."""
        known = self._known.get((id(parts), required))
        return super().plan(parts, required) if known is None else self.worded(*known)


class RelationPlanner:
    """GVMRN-RF: relations of pairs, and from them the moves."""

    def __init__(self, net: RelationNet, product: Product) -> None:
        self._net = net
        self._product = product

    def plan(self, parts: tuple[PartDetection, ...], required: int) -> GraspPlan:
        """A plan for `parts[required]`."""
        boxes = boxes_of(parts, self._product)
        graph = pair_graph(parts, self._product)
        exists = available(boxes, GripperOutline())
        blocks = np.zeros((*exists.shape, len(boxes)), dtype=bool)
        with torch.no_grad():
            logits = self._net(torch.from_numpy(graph.nodes), torch.from_numpy(graph.links)).numpy()
        blocks[graph.first, :, graph.second] = logits > 0
        blocks = mark_missing(blocks, exists)
        solution = solve(blocks, required, nearest_first(boxes, required))
        return solution.plan(1.0 if graspable(blocks)[required] else 0.0)
