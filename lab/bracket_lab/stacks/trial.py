"""Which object rests on which, found by trial: each is lifted, and what moves with it rested on it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bracket_sim.stacks.stacking import carriers_of
from bracket_sim.stacks.stage import Stage

LIFT_M, LIFT_M_S = 0.060, 0.20
MOVED_M = 0.003
DOUBTFUL_M = (0.0015, 0.006)  # a scene in which something moves so far is not taken: the next trial may say otherwise

Rests = NDArray[np.bool_]  # (n, n): [b, a] whether b rests on a


def relations(stage: Stage) -> Rests | None:
    """Who rests on whom: a carries b, or b moves by more than MOVED_M when a is lifted by LIFT_M.

    So b rests on a as well where others are between them. The stage is left as it was.

    Returns:
        (n, n), [b, a] whether b rests on a; None where that is doubtful: a movement near the limit, two objects that
        rest on each other, or one that moves without touching anything that leads to the lifted one.
    """
    count, before = len(stage.bodies), stage.state()
    touching, rests = _linked(stage), np.zeros((count, count), dtype=bool)
    for b, carriers in enumerate(carriers_of(stage)):
        rests[b, carriers] = True
    for a in range(count):
        stage.restore(before)
        moved = stage.lift(a, LIFT_M, LIFT_M_S)
        moved[a] = 0.0
        doubtful = (moved > DOUBTFUL_M[0]) & (moved < DOUBTFUL_M[1])
        unlinked = (moved > MOVED_M) & ~touching[a]
        if doubtful.any() or unlinked.any():
            stage.restore(before)
            return None
        rests[:, a] |= moved > MOVED_M
    stage.restore(before)
    return None if (rests & rests.T).any() else rests


def depth(rests: Rests) -> int:
    """Most relations in a chain."""
    count = len(rests)
    longest = np.zeros(count, dtype=int)
    for _ in range(count):
        longest = np.where(rests, longest[None] + 1, 0).max(axis=1, initial=0)
    return int(longest.max(initial=0))


def order_of_taking(rests: Rests, wanted: int) -> Sequence[int]:
    """What is to be taken before an object, in an order that works: what lies on top goes first."""
    left = set(np.flatnonzero(rests[:, wanted]).tolist())
    order: list[int] = []
    while left:
        free = min(one for one in left if not rests[list(left), one].any())
        order.append(free)
        left.remove(free)
    return order


def _linked(stage: Stage) -> Rests:
    """(n, n) whether contacts lead from one object to another, over others perhaps."""
    numbers = {body: number for number, body in enumerate(stage.bodies)}
    linked = np.eye(len(numbers), dtype=bool)
    for first, second in stage.contacts()[0].tolist():
        if first in numbers and second in numbers:
            linked[numbers[first], numbers[second]] = linked[numbers[second], numbers[first]] = True
    for _ in numbers:
        linked = (linked.astype(int) @ linked.astype(int)) > 0
    return linked
