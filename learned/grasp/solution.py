"""From "j blocks i" to the sequence of moves that frees a part, and its words (Alg. 2; section 3.2)."""

from __future__ import annotations

import string
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cell.interfaces.planning import GraspPlan
from learned.grasp.geometry import Blocks, Boxes


@dataclass(frozen=True)
class Solution:
    """How to come at one part.

    Attributes:
        moves: indices of parts to move away first, in order; each is free when its turn comes.
        needs_help: parts block each other in a circle, so no sequence of moves frees the part.
    """

    moves: tuple[int, ...] = ()
    needs_help: bool = False

    @property
    def text(self) -> str:
        """The words of the paper: parts have letters by index."""
        if self.needs_help:
            return "help"
        if not self.moves:
            return "grasp"
        return "move " + " and ".join(letter(index) for index in self.moves)

    def plan(self, graspable: float) -> GraspPlan:
        """This solution as a planner's answer."""
        return GraspPlan(graspable, self.moves, self.needs_help, self.text)


def letter(index: int) -> str:
    """a, b, ... z, aa, ab, ..."""
    letters = string.ascii_lowercase
    return letters[index] if index < len(letters) else letter(index // len(letters) - 1) + letter(index % len(letters))


def nearest_first(boxes: Boxes, required: int) -> list[int]:
    """Indices of all boxes: the required one, then the others by distance; the same whatever the detections' order."""
    offset = boxes.centre_m - boxes.centre_m[required]
    distance = np.hypot(offset[:, 0], offset[:, 1])
    distance[required] = -1.0
    keys = (boxes.centre_m[:, 1], boxes.centre_m[:, 0], np.round(distance, 9))
    return [int(index) for index in np.lexsort(keys)]


def solve(blocks: Blocks, required: int, order: Sequence[int]) -> Solution:
    """Fewest moves that free a part: all that block it, all that block those, and so on, each when it is free.

    Args:
        blocks: (n, n), [i, j] true where j blocks i.
        order: all indices; among parts that are free at the same time the first in this order moves first.
    """
    needed = _all_blockers(blocks, required)
    moves: list[int] = []
    while needed:
        free = [i for i in order if i in needed and not any(blocks[i, j] for j in (*needed, required))]
        if not free:
            return Solution(needs_help=True)
        moves.append(free[0])
        needed.remove(free[0])
    return Solution(tuple(moves))


def solves(moves: Sequence[int], blocks: Blocks, required: int) -> bool:
    """Whether the moves free a part with no needless one, each move being possible when its turn comes."""
    standing = set(range(len(blocks)))
    for index in (*moves, required):
        if index not in standing or any(blocks[index, j] for j in standing - {index}):
            return False
        standing.remove(index)
    return set(moves) == _all_blockers(blocks, required)


def _all_blockers(blocks: Blocks, required: int) -> set[int]:
    found: set[int] = set()
    open_ends = [required]
    while open_ends:
        new = [int(j) for j in np.flatnonzero(blocks[open_ends.pop()]) if j not in found and j != required]
        found.update(new)
        open_ends.extend(new)
    return found
