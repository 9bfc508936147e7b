"""Planners on torch networks, for experiments: the same decisions as at run time, without a detour through ONNX."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from cell.interfaces.perception import PartDetection
from cell.interfaces.planning import GraspPlan
from cell.interfaces.product import Product
from learned.grasp.boxes import boxes_of
from learned.grasp.options import available, graspable, mark_missing
from learned.grasp.relations import RelationNet, pair_graph
from learned.grasp.settings import GripperOutline
from learned.grasp.solution import nearest_first, solve


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
