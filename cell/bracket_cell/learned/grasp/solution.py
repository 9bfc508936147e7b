"""From "j blocks a candidate of i" to the sequence of moves that frees a part, and its words (Alg. 2; section 3.2)."""

from __future__ import annotations

import heapq
import string
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bracket_cell.learned.grasp.boxes import Blocks, Boxes
from bracket_ground.interfaces.planning import GraspPlan


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
    """Fewest moves that free a part, each moved part being free by some candidate when its turn comes.

    A best-first search over the candidates of all parts that are needed: what blocks a chosen one is needed, too.

    Args:
        blocks: (n, candidates, n), [i, c, j] true where j blocks candidate c of i; [i, c, i] where there is none.
        order: all indices; among parts that are free at the same time the first in this order moves first.
    """
    masks = _candidate_masks(blocks)
    if 0 in masks[required]:
        return Solution()
    open_choices: list[tuple[int, int, int, dict[int, int]]] = [(1, 0, 1 << required, {})]
    tries = 1
    while open_choices:
        _, _, needed, chosen = heapq.heappop(open_choices)
        undecided = next((i for i in order if needed >> i & 1 and i not in chosen), None)
        if undecided is None:
            moves = _schedule(chosen, required, order)
            if moves is not None:
                return Solution(moves)
            continue
        for mask in masks[undecided]:
            if not mask >> required & 1:
                grown = needed | mask
                entry = (grown.bit_count(), tries, grown, {**chosen, undecided: mask})
                heapq.heappush(open_choices, entry)
                tries += 1
    return Solution(needs_help=True)


def solves(moves: Sequence[int], blocks: Blocks, required: int) -> bool:
    """Whether the moves free a part, each being possible when its turn comes, and no shorter sequence would do."""
    standing = np.ones(len(blocks), dtype=bool)
    for index in (*moves, required):
        if not standing[index] or blocks[index][:, standing].any(axis=-1).all():
            return False
        standing[index] = False
    return len(moves) == len(solve(blocks, required, range(len(blocks))).moves)


def _candidate_masks(blocks: Blocks) -> list[list[int]]:
    """Of each part, its candidates as sets of blockers (bit j for part j), without needlessly blocked ones."""
    bits = 1 << np.arange(len(blocks), dtype=np.int64)
    found = []
    for part, row in enumerate((blocks @ bits).tolist()):
        real = [mask for mask in row if not mask >> part & 1]
        found.append(
            [m for k, m in enumerate(real) if not any(_better(other, m, k > j) for j, other in enumerate(real))]
        )
    return found


def _better(mask: int, than: int, earlier: bool) -> bool:
    """Whether all that blocks one candidate blocks the other, too, and more (or it came first)."""
    return mask & than == mask and (mask != than or earlier)


def _schedule(chosen: dict[int, int], required: int, order: Sequence[int]) -> tuple[int, ...] | None:
    """Order in which the chosen candidates become free, the required part left out; None if they wait in a circle."""
    waiting = {index: mask for index, mask in chosen.items() if index != required}
    standing = sum(1 << index for index in chosen)
    moves: list[int] = []
    while waiting:
        free = next((i for i in order if i in waiting and not waiting[i] & standing), None)
        if free is None:
            return None
        moves.append(free)
        standing &= ~(1 << free)
        del waiting[free]
    return tuple(moves)
