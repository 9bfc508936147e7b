"""Generated scenarios: every part of every goal, with what the demonstrator does next.

The paper's demonstrator always places the first missing object from the right (section 4.1): `from_the_right` relabels
scenarios so. Ours places any.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product as combinations

import numpy as np

from bracket_cell.learned.semantic.graph import EMPTY, Bools, Floats, Ints, Layout
from bracket_cell.learned.semantic.records import Demonstration
from bracket_lab.learned.semantic.misdetection import Scenarios


def states_of(layout: Layout, demonstrations: Sequence[Demonstration]) -> Scenarios:
    """The states that demonstrations went through, each with the position that was filled next.

    `following` is EMPTY where the robot filled it: that tells nothing of people's habits. Demonstrations of goals that
    the layout does not have are left out.
    """
    known = [demonstration for demonstration in demonstrations if demonstration.goal in layout.goals]
    rows = [row for demonstration in known for row in _rows(layout, demonstration)]
    goals, seen, following = zip(*rows, strict=True)
    return Scenarios(np.array(goals), np.array(seen), np.array(following))


def _rows(layout: Layout, demonstration: Demonstration) -> Iterator[tuple[int, list[int], int]]:
    goal = layout.goals.index(demonstration.goal)
    seen = [EMPTY] * len(layout.positions)
    for count, placed in enumerate(demonstration.placements):
        position = layout.positions.index(placed.position)
        if count >= demonstration.unordered_n:
            yield goal, list(seen), position if placed.by == "person" else EMPTY
        seen[position] = layout.parts.index(placed.part)


SCENARIO_LIMIT = 20_000  # products with more partial states are sampled
TRAIN_RATIO = 0.77  # 143 of 186 scenarios with the default product, as in the paper


@dataclass(frozen=True, eq=False)
class Demonstrators:
    """People who fill slots one after the other, each open one with odds exp(preference) (Plackett and Luce).

    Attributes:
        preferences: (demonstrators, z, m).
    """

    layout: Layout
    preferences: Floats

    def orders(self, goals: Ints, rng: np.random.Generator) -> Ints:
        """(B, m) positions in the order in which a random one of them fills them, for goals (B,)."""
        person = rng.integers(len(self.preferences), size=len(goals))
        preferred = self.preferences[person, goals]
        order: Ints = np.argsort(-(preferred + rng.gumbel(size=preferred.shape)), axis=1)
        return order


def runs(demonstrators: Demonstrators, count: int, depth: int, rng: np.random.Generator) -> tuple[Scenarios, Ints]:
    """States after 1 .. `depth` placements of `count` assemblies, and the number of placements of each."""
    layout = demonstrators.layout
    goals = rng.integers(len(layout.goals), size=count)
    ranks = np.argsort(demonstrators.orders(goals, rng), axis=1)
    steps = np.repeat(np.arange(1, depth + 1), count)
    rows = np.tile(np.arange(count), depth)
    seen = np.where(ranks[rows] < steps[:, None], layout.types[goals[rows]], EMPTY)
    following = np.argmax(ranks[rows] == steps[:, None], axis=1)
    return Scenarios(goals[rows], seen, following), steps


def scenarios(layout: Layout, seed: int) -> Scenarios:
    """All partial states of all goals, z (2^m - 2), or a sample where they are more than SCENARIO_LIMIT."""
    goals, positions = layout.types.shape
    rng = np.random.default_rng(seed)
    if goals * (2**positions - 2) > SCENARIO_LIMIT:
        return sampled(layout, SCENARIO_LIMIT, rng)
    masks = np.array(list(combinations([False, True], repeat=positions)))[1:-1]
    labels = np.repeat(np.arange(goals), len(masks))
    return _labelled(layout, labels, np.tile(masks, (goals, 1)), rng)


def from_the_right(whole: Scenarios) -> Scenarios:
    """The same states, the first open position from the right being filled next; positions are listed right to left."""
    following: Ints = np.argmax(whole.seen == EMPTY, axis=1)
    return Scenarios(whole.goals, whole.seen, following)


def sampled(layout: Layout, count: int, rng: np.random.Generator) -> Scenarios:
    """Random goals after a random number of placements in random order."""
    labels = rng.integers(len(layout.goals), size=count)
    masks = _random_masks(count, len(layout.positions), rng)
    return _labelled(layout, labels, masks, rng)


def unknown_goals(layout: Layout, masks: Bools, rng: np.random.Generator) -> Scenarios:
    """Goals that were never demonstrated, one for each row of `masks` (B, m): other arrangements of the same parts.

    Fewer rows come back where nearly all arrangements are goals.
    """
    parts = np.repeat(np.arange(len(layout.parts)), layout.quantities)
    types = rng.permuted(np.tile(parts, (2 * len(masks) + 20, 1)), axis=1)
    types = types[~(types[:, None, :] == layout.types).all(axis=2).any(axis=1)][: len(masks)]
    masks = masks[: len(types)]
    labels = np.full(len(types), len(layout.goals))
    return Scenarios(labels, np.where(masks, types, EMPTY), _any_open(masks, rng))


def split(whole: Scenarios, ratio: float, seed: int) -> tuple[Scenarios, Scenarios]:
    """Shuffle and divide: (`ratio` of the rows, the others)."""
    order = np.random.default_rng(seed).permutation(len(whole))
    count = round(ratio * len(whole))
    return whole.take(order[:count]), whole.take(order[count:])


def sub_demonstrations(layout: Layout, train: Scenarios) -> Scenarios:
    """Also the states that a demonstration passed through on any order of its placements, each once.

    These regenerate held-out scenarios from training ones: report scores with and without them.
    """
    known = {(int(goal), tuple(seen != EMPTY)) for goal, seen in zip(train.goals, train.seen, strict=True)}
    masks = {
        (goal, part)
        for goal, mask in known
        for part in combinations(*([False, True] if filled else [False] for filled in mask))
        if any(part)
    }
    rows = sorted(masks)
    rng = np.random.default_rng(len(rows))
    return _labelled(layout, np.array([goal for goal, _ in rows]), np.array([mask for _, mask in rows]), rng)


def consistent(layout: Layout, seen: Ints) -> Bools:
    """(B, z) the label set of every state: the goals that hold all its placements."""
    fits: Bools = ((seen[:, None, :] == EMPTY) | (seen[:, None, :] == layout.types)).all(axis=2)
    return fits


def bound(layout: Layout, whole: Scenarios) -> float:
    """Success rate that no planner beats: where k goals fit a state, it names the right one in 1 of k cases.

    Over all scenarios this is the number of distinct states divided by the number of scenarios.
    """
    return float(np.mean(1.0 / consistent(layout, whole.seen).sum(axis=1)))


def _labelled(layout: Layout, labels: Ints, masks: Bools, rng: np.random.Generator) -> Scenarios:
    seen = np.where(masks, layout.types[labels], EMPTY)
    return Scenarios(labels, seen, _any_open(masks, rng))


def _any_open(masks: Bools, rng: np.random.Generator) -> Ints:
    following: Ints = np.argmax(rng.random(masks.shape) - 2.0 * masks, axis=1)
    return following


def _random_masks(count: int, positions: int, rng: np.random.Generator) -> Bools:
    filled = rng.integers(1, positions, size=count)
    ranks = rng.permuted(np.tile(np.arange(positions), (count, 1)), axis=1)
    masks: Bools = ranks < filled[:, None]
    return masks
