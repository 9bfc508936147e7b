"""A hierarchical task network by hand: the third planner that the paper argues against, as a baseline.

`build` has one method for each goal of the product; a method builds the types one after the other, each by placing its
parts from the right. Placing is primitive. A state is explained by a goal if its method could have led to it, in any
order of the placements: people keep to none. What the state is not explained by does not exist: no noise, no habits,
no degrees of belief. Goals that explain it are equally likely, and of a state that none explains nothing is said.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from bracket_ground.interfaces.planning import UNKNOWN_GOAL, AssemblyPlan, AssemblyState, Placement
from bracket_ground.interfaces.product import Product


@dataclass(frozen=True)
class Task:
    """A task of the network.

    Attributes:
        placement: of a primitive task; None for one that a method decomposes.
        subtasks: in the order of the plan.
    """

    name: str
    placement: Placement | None = None
    subtasks: tuple[Task, ...] = ()

    def primitives(self) -> Iterator[Placement]:
        """All placements of its decomposition, in order."""
        if self.placement is not None:
            yield self.placement
        for task in self.subtasks:
            yield from task.primitives()


def methods_of(product: Product) -> dict[str, Task]:
    """The methods of `build`, by goal."""
    return {goal: _method(product, goal) for goal in product.goals}


def _method(product: Product, goal: str) -> Task:
    wanted = product.goal_placements(goal)
    kinds = []
    for part in product.parts:
        places = tuple(
            Task(f"place {part} at {position}", (part, position))
            for position in product.positions
            if wanted[position] == part
        )
        kinds.append(Task(f"place every {part}", subtasks=places))
    return Task(f"build {goal}", subtasks=tuple(kinds))


class HtnPlanner:
    """Explains a state by the methods that could have led to it, and plans what is left of them (SemanticPlanner)."""

    def __init__(self, product: Product) -> None:
        self._product = product
        self._plans = {goal: tuple(task.primitives()) for goal, task in methods_of(product).items()}

    def plan(self, state: AssemblyState) -> AssemblyPlan:
        """Belief, next object and a plan for every object."""
        done = {(part, position) for position, part in state.placed.items()}
        fits = [goal for goal, plan in self._plans.items() if done <= set(plan)]
        if not fits:
            belief = dict.fromkeys(self._plans, 0.0) | {UNKNOWN_GOAL: 1.0}
            return AssemblyPlan(belief, {}, None, dict.fromkeys(self._product.parts, ()))
        belief = {goal: (goal in fits) / len(fits) for goal in self._plans} | {UNKNOWN_GOAL: 0.0}
        left = {goal: [step for step in self._plans[goal] if step not in done] for goal in fits}
        first = left[fits[0]]
        guidance = {part: tuple(at for kind, at in first if kind == part) for part in self._product.parts}
        return AssemblyPlan(belief, _shares(left), first[0][0] if first else None, guidance)


def _shares(left: Mapping[str, list[Placement]]) -> dict[Placement, float]:
    """How many of the goals that fit still want each placement."""
    found: dict[Placement, float] = {}
    for plan in left.values():
        for step in plan:
            found[step] = found.get(step, 0.0) + 1 / len(left)
    return found
