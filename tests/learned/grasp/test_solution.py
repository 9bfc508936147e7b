"""The sequence of moves against exhaustive search, and the words for it."""

from __future__ import annotations

from collections import Counter
from itertools import permutations

import numpy as np
import pytest

from bracket_cell.learned.grasp.boxes import Blocks, boxes_of
from bracket_cell.learned.grasp.solution import Solution, letter, solve, solves
from bracket_ground.errors import ModelError
from bracket_lab.learned.grasp.language import END, HELP, MAX_WORDS, decode, encode, words_of
from tests.learned.grasp.layouts import PRODUCT, chain, standing


def fewest_moves(blocks: Blocks, required: int) -> int | None:
    """Length of the shortest sequence of possible moves, by trying them all."""
    count = len(blocks)
    others = [i for i in range(count) if i != required]
    for length in range(count):
        for moves in permutations(others, length):
            standing = set(range(count))
            for index in (*moves, required):
                if blocks[index][:, sorted(standing)].any(axis=1).all():
                    break
                standing.remove(index)
            else:
                return length
    return None


def random_blocks(rng: np.random.Generator, count: int) -> Blocks:
    """Two candidates each; a missing one is blocked by the part itself."""
    blocks: Blocks = rng.random((count, 2, count)) < rng.choice([0.25, 0.35, 0.5])
    parts = np.arange(count)
    blocks[parts, :, parts] = rng.random((count, 2)) < 0.2
    return blocks


def one_option(pairs: list[tuple[int, int]]) -> Blocks:
    """Four parts, each with one candidate; (i, j) where j blocks i."""
    blocks = np.zeros((4, 1, 4), dtype=bool)
    for i, j in pairs:
        blocks[i, 0, j] = True
    return blocks


def test_solutions_are_the_shortest_and_work() -> None:
    rng = np.random.default_rng(2)
    lengths = Counter[int | None]()
    for _ in range(1000):
        blocks = random_blocks(rng, int(rng.integers(2, 6)))
        solution = solve(blocks, 0, range(len(blocks)))
        fewest = fewest_moves(blocks, 0)
        lengths[fewest] += 1
        assert solution.needs_help == (fewest is None)
        if fewest is not None:
            assert len(solution.moves) == fewest
            assert solves(solution.moves, blocks, 0)
    assert min(lengths[None], lengths[0], lengths[1], lengths[2], lengths[3]) >= 10


def test_needless_missing_and_early_moves_do_not_solve() -> None:
    blocks = one_option([(0, 1), (1, 2)])
    assert solves((2, 1), blocks, 0)
    for moves in ((), (1,), (2,), (1, 2), (2, 1, 3), (2, 2, 1)):
        assert not solves(moves, blocks, 0)


def test_the_option_with_fewer_moves_is_taken() -> None:
    blocks = np.zeros((4, 2, 4), dtype=bool)
    blocks[0, 0, [1, 2]] = blocks[0, 1, 3] = True
    assert solve(blocks, 0, range(4)).moves == (3,)
    assert not solves((1, 2), blocks, 0)
    blocks[3, :, 0] = True  # part 3 waits for the required one in both of its candidates
    assert solve(blocks, 0, range(4)).moves == (1, 2)


def test_the_order_decides_among_free_parts_only() -> None:
    blocks = one_option([(0, 1), (0, 2), (0, 3), (3, 2)])
    assert solve(blocks, 0, (0, 1, 2, 3)).moves == (1, 2, 3)
    assert solve(blocks, 0, (0, 3, 2, 1)).moves == (2, 3, 1)


def test_words() -> None:
    assert Solution().text == "grasp"
    assert Solution((1,)).text == "move b"
    assert Solution((1, 2)).text == "move b and c"
    assert Solution(needs_help=True).text == "help"
    assert [letter(index) for index in (0, 25, 26, 27)] == ["a", "z", "aa", "ab"]


def test_decode_after_encode_is_the_identity() -> None:
    names = list(PRODUCT.parts)
    boxes = boxes_of(chain(), PRODUCT)
    types = [names.index(name) for name in boxes.types]
    for solution in (Solution(), Solution((1,)), Solution((2, 1)), Solution(needs_help=True)):
        words = encode(solution, types)
        assert len(words) == MAX_WORDS
        assert decode(words, boxes, names, 0) == solution


def test_the_part_that_is_meant_is_the_nearest_of_its_type() -> None:
    parts = (standing("o2", 0.0, 0.0), standing("o1", 0.2, 0.0), standing("o1", 0.0, 0.04), standing("o1", 0.0, 0.09))
    names, boxes = list(PRODUCT.parts), boxes_of(parts, PRODUCT)
    move, o1 = words_of(names).index("move"), words_of(names).index("o1")
    assert decode([move, o1, END], boxes, names, 0) == Solution((2,))
    assert decode([move, o1, o1, END], boxes, names, 0) == Solution((3, 2))


@pytest.mark.parametrize(
    "sentence",
    [
        ["move"],
        ["move", "help"],
        ["move", "o1", "move"],
        ["o1"],
        ["move", "o1", "o1"],
        ["move", "o2"],
    ],
)
def test_words_that_are_no_solution_are_refused(sentence: list[str]) -> None:
    parts = (standing("o3", 0.0, 0.0), standing("o1", 0.0, 0.05), standing("o3", 0.0, -0.05))
    words = [words_of(list(PRODUCT.parts)).index(word) for word in sentence]
    with pytest.raises(ModelError, match="no solution for 3 parts"):
        decode([*words, END], boxes_of(parts, PRODUCT), list(PRODUCT.parts), 0)


def test_words_outside_the_vocabulary_are_refused() -> None:
    with pytest.raises(ModelError, match="outside the vocabulary"):
        decode([HELP, 99], boxes_of(chain(), PRODUCT), list(PRODUCT.parts), 0)
