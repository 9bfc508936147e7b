"""Scenarios as demonstrations, for tests of files and commands."""

from __future__ import annotations

import numpy as np

from bracket_cell.learned.semantic.graph import EMPTY, Layout
from bracket_cell.learned.semantic.records import Demonstration, PlacementRecord
from bracket_lab.learned.semantic.misdetection import Scenarios


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
