"""Grasp planner by geometry alone: the gripper's outline, margins included, against the detected boxes."""

from __future__ import annotations

from cell.interfaces.perception import PartDetection
from cell.interfaces.planning import GraspPlan
from cell.interfaces.product import Product
from learned.grasp.boxes import boxes_of
from learned.grasp.candidates import fixed, graspable, middle_alone
from learned.grasp.physics import touching
from learned.grasp.settings import WITH_MARGINS, GripperOutline
from learned.grasp.solution import nearest_first, solve


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
