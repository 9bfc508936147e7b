"""Words of the decoded solution name types, as the paper's do: "move o1 and o3", "help"; the word "and" is not decoded.

Which part of a type is meant is the one whose body is nearest to what it must stand in the way of.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bracket_cell.learned.grasp.boxes import Boxes, rectangle_gaps_m
from bracket_cell.learned.grasp.solution import Solution
from bracket_ground.errors import ModelError
from bracket_ground.interfaces.pose import Array

END, GRASP, HELP, MOVE = range(4)
FIRST_TYPE = 4
MAX_MOVES = 5
MAX_WORDS = 1 + MAX_MOVES


def words_of(parts: Sequence[str]) -> tuple[str, ...]:
    """The vocabulary of a product with these part types."""
    return ("end", "grasp", "help", "move", *parts)


def encode(solution: Solution, types: Sequence[int]) -> list[int]:
    """Word numbers (MAX_WORDS) of a solution, filled up with "end".

    Args:
        types: number of every part's type.
    """
    if solution.needs_help:
        words = [HELP]
    elif solution.moves:
        words = [MOVE, *(FIRST_TYPE + types[index] for index in solution.moves[:MAX_MOVES])]
    else:
        words = [GRASP]
    return words + [END] * (MAX_WORDS - len(words))


def decode(words: Sequence[int], boxes: Boxes, types: Sequence[str], required: int) -> Solution:
    """The solution that words name.

    Args:
        types: those that the vocabulary has, in its order.
        required: the part that is to be freed.

    Raises:
        ModelError: a word outside the vocabulary, a part that is not there, or no sentence.
    """
    vocabulary = words_of(types)
    if outside := [word for word in words if not 0 <= word < len(vocabulary)]:
        raise ModelError(f"decoded words {outside} outside the vocabulary of {len(vocabulary)} words")
    sentence = list(words[: list(words).index(END)] if END in words else words)
    if sentence == [GRASP]:
        return Solution()
    if sentence == [HELP]:
        return Solution(needs_help=True)
    named = [word - FIRST_TYPE for word in sentence[1:]]
    moves = None
    if sentence[:1] == [MOVE] and named and min(named) >= 0:
        moves = _parts_meant([types[number] for number in named], boxes, required)
    if moves is None:
        said = " ".join(vocabulary[word] for word in sentence)
        raise ModelError(f"decoded {said!r}, no solution for {len(boxes)} parts")
    return Solution(moves)


def _parts_meant(types: Sequence[str], boxes: Boxes, required: int) -> tuple[int, ...] | None:
    """From the last to be moved to the first: each the nearest of its type to what is to be freed so far."""
    freed = [required]
    for name in reversed(types):
        left = [index for index, kind in enumerate(boxes.types) if kind == name and index not in freed]
        if not left:
            return None
        freed.append(left[0] if len(left) == 1 else _nearest(left, freed, boxes))
    return tuple(freed[:0:-1])


def _nearest(some: list[int], freed: list[int], boxes: Boxes) -> int:
    """Of some bodies the one with the narrowest gap to one of the others."""
    tried, others = boxes.take(some), boxes.take(freed)
    gaps = rectangle_gaps_m(
        tried.centre_m[:, None],
        tried.yaw_rad[:, None],
        tried.size_m[:, None, :2] / 2,
        others.centre_m[None],
        others.yaw_rad[None],
        others.size_m[None, :, :2] / 2,
    )
    return some[int(np.round(gaps.min(axis=1), 9).argmin())]


def grammar(parts: int) -> Array:
    """(words + 1, words): 0 where a word may follow another (last row: begins a sentence), else -1e9."""
    count = FIRST_TYPE + parts
    allowed = np.full((count + 1, count), -1e9)
    allowed[[END, GRASP, HELP], END] = 0.0
    allowed[MOVE:count, FIRST_TYPE:] = 0.0
    allowed[FIRST_TYPE:count, END] = 0.0
    allowed[count, [HELP, MOVE]] = 0.0
    return allowed
