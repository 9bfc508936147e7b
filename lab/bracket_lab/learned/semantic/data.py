"""States of recorded demonstrations, for planners to learn from, and demonstrations made of scenarios."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from bracket_cell.learned.semantic.graph import EMPTY, Layout
from bracket_cell.learned.semantic.misdetection import Scenarios
from bracket_cell.learned.semantic.records import Demonstration, PlacementRecord


def states_of(layout: Layout, demonstrations: Sequence[Demonstration]) -> Scenarios:
    """The states that demonstrations went through, each with the position that was filled next.

    `following` is EMPTY where the robot filled it: that tells nothing of people's habits. Demonstrations of goals that
    the layout does not have are left out.
    """
    known = [demonstration for demonstration in demonstrations if demonstration.goal in layout.goals]
    rows = [row for demonstration in known for row in _rows(layout, demonstration)]
    goals, seen, following = zip(*rows, strict=True)
    return Scenarios(np.array(goals), np.array(seen), np.array(following))


def demonstrations_of(layout: Layout, whole: Scenarios) -> list[Demonstration]:
    """Scenarios as demonstrations: a state in no order, and the placement that followed it."""
    return [
        Demonstration(
            goal=layout.goals[goal],
            placements=tuple(
                PlacementRecord(part=layout.parts[layout.types[goal, i]], position=layout.positions[i])
                for i in [*np.flatnonzero(seen != EMPTY), following]
            ),
            unordered_n=int((seen != EMPTY).sum()),
        )
        for goal, seen, following in zip(whole.goals, whole.seen, whole.following, strict=True)
    ]


def _rows(layout: Layout, demonstration: Demonstration) -> Iterator[tuple[int, list[int], int]]:
    goal = layout.goals.index(demonstration.goal)
    seen = [EMPTY] * len(layout.positions)
    for count, placed in enumerate(demonstration.placements):
        position = layout.positions.index(placed.position)
        if count >= demonstration.unordered_n:
            yield goal, list(seen), position if placed.by == "person" else EMPTY
        seen[position] = layout.parts.index(placed.part)
