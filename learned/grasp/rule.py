"""Grasp planner by geometry alone: the gripper's outline against the detected boxes."""

from __future__ import annotations

from cell.interfaces.perception import PartDetection
from cell.interfaces.planning import GraspPlan
from cell.interfaces.product import Product
from learned.grasp.boxes import boxes_of
from learned.grasp.geometry import blocking
from learned.grasp.options import graspable
from learned.grasp.settings import GripperGeometry
from learned.grasp.solution import nearest_first, solve


class RulePlanner:
    """Needs no weights; trusts every detection as if it were exact."""

    def __init__(self, product: Product, gripper: GripperGeometry | None = None) -> None:
        self._product = product
        self._gripper = gripper or GripperGeometry()

    def plan(self, parts: tuple[PartDetection, ...], required: int) -> GraspPlan:
        """A plan for `parts[required]`."""
        boxes = boxes_of(parts, self._product)
        blocks = blocking(boxes, self._gripper)
        solution = solve(blocks, required, nearest_first(boxes, required))
        return solution.plan(1.0 if graspable(blocks)[required] else 0.0)
