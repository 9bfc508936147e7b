"""Words of the decoded solution: "move b and c", "help"; letters name nodes of the scene graph."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cell.interfaces.errors import ModelError
from cell.interfaces.pose import Array
from learned.grasp.graph import MAX_PARTS
from learned.grasp.solution import Solution, letter

LETTERS = tuple(letter(index) for index in range(MAX_PARTS))
WORDS = ("end", "grasp", "help", "move", "and", *LETTERS)
MAX_MOVES = 5
MAX_WORDS = 2 * MAX_MOVES + 1
END, GRASP, HELP, MOVE, AND = range(5)
FIRST_LETTER = 5


def encode(solution: Solution, order: Sequence[int]) -> list[int]:
    """Word numbers (MAX_WORDS) of a solution, filled up with "end".

    Args:
        order: index of the part behind each node.
    """
    if solution.needs_help:
        words = [HELP]
    elif solution.moves:
        letters = [FIRST_LETTER + list(order).index(index) for index in solution.moves[:MAX_MOVES]]
        words = [MOVE, *[word for number in letters for word in (number, AND)][:-1]]
    else:
        words = [GRASP]
    return words + [END] * (MAX_WORDS - len(words))


def decode(words: Sequence[int], order: Sequence[int]) -> Solution:
    """The solution that words name.

    Raises:
        ModelError: a word outside the vocabulary, a letter without a part, or no sentence.
    """
    if outside := [word for word in words if not 0 <= word < len(WORDS)]:
        raise ModelError(f"decoded words {outside} outside the vocabulary of {len(WORDS)} words")
    sentence = list(words[: list(words).index(END)] if END in words else words)
    if sentence == [GRASP]:
        return Solution()
    if sentence == [HELP]:
        return Solution(needs_help=True)
    nodes = [word - FIRST_LETTER for word in sentence[1::2]]
    well_formed = len(sentence) % 2 == 0 and sentence[:1] == [MOVE] and set(sentence[2::2]) <= {AND}
    if not well_formed or not all(1 <= node < len(order) for node in nodes) or len(set(nodes)) < len(nodes):
        raise ModelError(f"decoded {' '.join(WORDS[word] for word in sentence)!r}, no solution for {len(order)} parts")
    return Solution(tuple(order[node] for node in nodes))


def grammar() -> Array:
    """(words + 1, words): 0 where a word may follow another (last row: begins a sentence), else -1e9."""
    count = len(WORDS)
    letters = list(range(FIRST_LETTER + 1, count))
    allowed = np.full((count + 1, count), -1e9)
    allowed[[END, GRASP, HELP], END] = 0.0
    allowed[np.ix_([MOVE, AND], letters)] = 0.0
    allowed[np.ix_(letters, [AND, END])] = 0.0
    allowed[count, [HELP, MOVE]] = 0.0
    return allowed
