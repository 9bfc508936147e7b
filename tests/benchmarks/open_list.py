"""Wrong acts of `bayes`: while goals are learned from finished brackets, and under confusions that it learned.

python -m tests.benchmarks.open_list streams --act 0.9 --act 0.92 --first-seed 1001 --seeds 40
python -m tests.benchmarks.open_list confusions --act 0.9 --act 0.92 --first-seed 1001 --seeds 10

streams: 60 brackets, three of the goals in use being listed, 5 % of the actions taken for an alike type, no question.
confusions: brackets of listed goals; the matrix is learned from 500 confirmed actions of others, 5 or 10 % wrong.
After each of 1 to 5 actions the robot acts or waits; a camera sees which holes are filled. 95 % intervals by Wilson.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np
from rich.console import Console
from rich.table import Table

from learned.semantic.confusions import PATTERNS, Confusions, Pattern
from learned.semantic.experiments.streams import BRACKETS, ERROR, IN_USE, NEVER, assemble, unlisted
from learned.semantic.goals import OpenGoals
from learned.semantic.graph import Ints, Layout
from learned.semantic.planner import BayesPlanner
from tests.benchmarks.intervals import wilson
from tests.integration.cell_rig import PRODUCT

LAYOUT = Layout.of(PRODUCT)
REPORTS, KNOWN = 500, 200  # confirmed actions that a matrix is learned from, and brackets of known goals, of each seed
States = Sequence[dict[str, bool]]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["streams", "confusions"])
    parser.add_argument("--act", type=float, action="append", help="least probability of an act; may be repeated")
    parser.add_argument("--first-seed", type=int, default=1001)
    parser.add_argument("--seeds", type=int, default=10)
    options = parser.parse_args()
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    table = Table("case", "act from", "acts", "wrong", "95 % interval", "states in which it acts")
    for act in options.act or [0.9]:
        for case, states in (streams if options.what == "streams" else known)(seeds, act):
            table.add_row(case, f"{act:g}", *_cells(states))
    Console(width=120).print(table)


def streams(seeds: Sequence[int], act: float) -> Iterator[tuple[str, list[dict[str, bool]]]]:
    """All states of all streams by goals in use, and those of the second halves."""
    for in_use in IN_USE:
        halves: tuple[list[dict[str, bool]], list[dict[str, bool]]] = ([], [])
        for seed in seeds:
            for number, states in enumerate(stream(in_use, seed, act)):
                halves[number >= BRACKETS // 2].extend(states)
        yield f"{in_use} in use, all", [*halves[0], *halves[1]]
        yield f"{in_use} in use, second half", halves[1]


def stream(in_use: int, seed: int, act: float) -> Iterator[States]:
    """The states of one bracket after the other; every finished one is learned from."""
    rng = np.random.default_rng([seed, in_use])
    used = [*LAYOUT.types[: min(in_use, len(LAYOUT.types))], *unlisted(LAYOUT, in_use - len(LAYOUT.types), rng)]
    confusions = Confusions.of(LAYOUT, "alike types", ERROR)
    goals = OpenGoals.of(PRODUCT)
    for _ in range(BRACKETS):
        types = used[rng.integers(in_use)]
        yield assemble(BayesPlanner(PRODUCT, goals, confusions), LAYOUT, types, confusions, rng, NEVER, act)
        goals = goals.with_bracket(tuple(LAYOUT.parts[part] for part in types))


def known(seeds: Sequence[int], act: float) -> Iterator[tuple[str, list[dict[str, bool]]]]:
    """All states of brackets of listed goals, by what is confused and how often."""
    for pattern in PATTERNS:
        for error in (ERROR, 2 * ERROR):
            states = [state for seed in seeds for one in _brackets(pattern, error, seed, act) for state in one]
            yield f"{pattern}, {error:.0%}", states


def _brackets(pattern: Pattern, error: float, seed: int, act: float) -> Iterator[States]:
    rng = np.random.default_rng([seed, 7])
    true = Confusions.of(LAYOUT, pattern, error)
    learned = Confusions.learned(LAYOUT, _reports(true, rng))
    planner = BayesPlanner(PRODUCT, OpenGoals.of(PRODUCT), learned)
    for types in LAYOUT.types[rng.integers(len(LAYOUT.types), size=KNOWN)]:
        yield assemble(planner, LAYOUT, types, true, rng, NEVER, act)


def _reports(confusions: Confusions, rng: np.random.Generator) -> Iterator[tuple[tuple[str, str], tuple[str, str]]]:
    """Confirmed actions of listed goals: as they were, and as they were reported."""
    names = [(part, position) for part in LAYOUT.parts for position in LAYOUT.positions]
    for _ in range(REPORTS):
        types: Ints = LAYOUT.types[rng.integers(len(LAYOUT.types))]
        position = int(rng.integers(len(types)))
        action = int(types[position]) * len(types) + position
        yield names[action], names[int(rng.choice(len(names), p=confusions.matrix[action]))]


def _cells(states: States) -> tuple[str, ...]:
    counts = Counter((state["acts"], state["wrong"]) for state in states)
    wrong, acts = counts[True, True], counts[True, True] + counts[True, False]
    low, high = wilson(wrong, acts)
    share = wrong / max(1, acts)
    return str(acts), f"{share:.4f}", f"{low:.4f} - {high:.4f}", f"{acts / max(1, len(states)):.3f}"


if __name__ == "__main__":
    main()
