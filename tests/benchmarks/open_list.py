"""Goals that nobody listed: what the guard's settings lead to with the exact planner, in four tables.

python -m tests.benchmarks.open_list --first-seed 5001 --seeds 20

streams: 60 brackets, three of the goals in use being listed, 5 % of the actions taken for an alike type; every finished
bracket is learned from; while nobody is asked, and while one question is answered.
meetings: 400 brackets of listed goals, 400 of goals that were never shown, and of these after they were finished twice.
confusions: brackets of listed goals; the matrix is learned from 500 confirmed actions of others, 5 or 10 % wrong.
After each of 1 to 5 actions the robot acts, asks or waits; a camera sees which holes are filled. 95 % intervals by
Wilson.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from rich.console import Console
from rich.table import Table

from bracket_cell.learned.inference.scores import wilson
from bracket_cell.learned.semantic.confusions import PATTERNS, Confusions, Pattern
from bracket_cell.learned.semantic.goals import OpenGoals
from bracket_cell.learned.semantic.graph import Ints, Layout
from bracket_cell.learned.semantic.model import BayesPlanner
from bracket_cell.trees.guard import Guard, GuardSettings
from bracket_lab.experiments.experiments import Values
from bracket_lab.experiments.semantic_streams import (
    BRACKETS,
    ERROR,
    IN_USE,
    assemble,
    first_meetings,
    unlisted,
)
from tests.integration.cell_rig import PRODUCT

LAYOUT = Layout.of(PRODUCT)
REPORTS, KNOWN = 500, 200  # confirmed actions that a matrix is learned from, and brackets of known goals, of each seed
BARS = {("nobody asked", 12, False): 0.05, ("nobody asked", 12, True): 0.02}
States = Sequence[dict[str, bool]]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["all", "streams", "meetings", "confusions"], nargs="?", default="all")
    parser.add_argument("--wrong", type=float, default=GuardSettings().wrong_act_s, help="guard.wrong_act_s")
    parser.add_argument("--question", type=float, default=GuardSettings().question_s, help="guard.question_s")
    parser.add_argument("--first-seed", type=int, default=1001)
    parser.add_argument("--seeds", type=int, default=10)
    options = parser.parse_args()
    guard = GuardSettings(wrong_act_s=options.wrong, question_s=options.question)
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    tables = {"streams": streams, "meetings": meetings, "confusions": known}
    for name, table in tables.items():
        if options.what in (name, "all"):
            Console(width=120).print(table(seeds, guard))


def streams(seeds: Sequence[int], guard: GuardSettings) -> Table:
    """Wrong acts by goals in use; in all, and in the second half."""
    table = Table("in use", "", "half", "acts", "wrong", "95 % interval", "bar", "acts in", "asked", title="streams")
    for rule, answers in (("nobody asked", False), ("one question", True)):
        for in_use in IN_USE:
            found = [states for seed in seeds for states in enumerate(stream(in_use, seed, guard, answers=answers))]
            for second in (False, True):
                some = [states for number, states in found if not second or number >= BRACKETS // 2]
                bar = BARS.get((rule, in_use, second))
                asked = sum(any(state["asked"] for state in states) for states in some) / len(some)
                acts, wrong, interval, share = _cells([state for states in some for state in states])
                half = "second" if second else "both"
                shown = "" if bar is None else f"{bar:g}"
                table.add_row(str(in_use), rule, half, acts, wrong, interval, shown, share, f"{asked:.3f}")
    return table


def stream(in_use: int, seed: int, guard: GuardSettings, *, answers: bool = False) -> Iterator[States]:
    """The states of one bracket after the other; every finished one is learned from."""
    rng = np.random.default_rng([seed, in_use])
    used = [*LAYOUT.types[: min(in_use, len(LAYOUT.types))], *unlisted(LAYOUT, in_use - len(LAYOUT.types), rng)]
    confusions = Confusions.of(LAYOUT, "alike types", ERROR)
    goals = OpenGoals.of(PRODUCT)
    for _ in range(BRACKETS):
        types = used[rng.integers(in_use)]
        planner = BayesPlanner(PRODUCT, goals, confusions)
        yield assemble(planner, Guard(goals.product, guard), types, confusions, rng, answers=answers)
        goals = goals.with_bracket(tuple(LAYOUT.parts[part] for part in types))


def meetings(seeds: Sequence[int], guard: GuardSettings) -> Table:  # noqa: ARG001 the guard's defaults hold
    """Goals never shown, known ones, and those that were finished twice, with one question; of the first seed."""
    columns = ("confused", "never shown: wrong assemblies (bar .10)", "asked", "known: acts in (bar .85)", "wrong acts")
    table = Table(*columns, "asked", "acts after finished twice, of a listed goal's (bar .90)", title="first meetings")
    for pattern in PATTERNS:
        found = first_meetings(PRODUCT, "bayes", pattern, True, seeds[0])
        names = ("wrong_assemblies_unknown", "asked_unknown", "coverage_known", "wrong_acts_known", "asked_known")
        shown = [_share(found, name) for name in names]
        twice = found["coverage_seen_twice"] / found["coverage_as_listed"]
        table.add_row(pattern, *shown, f"{twice:.3f}")
    return table


def known(seeds: Sequence[int], guard: GuardSettings) -> Table:
    """Brackets of listed goals, by what is confused and how often."""
    table = Table("confused", "acts", "wrong", "95 % interval", "bar", "acts in", title="learned confusions")
    for pattern in PATTERNS:
        for error in (ERROR, 2 * ERROR):
            brackets = (one for seed in seeds for one in _brackets(pattern, error, seed, guard))
            acts, wrong, interval, share = _cells([state for one in brackets for state in one])
            bar = "0.005" if pattern == "neighbouring holes" and error > ERROR else ""
            table.add_row(f"{pattern}, {error:.0%}", acts, wrong, interval, bar, share)
    return table


def _brackets(pattern: Pattern, error: float, seed: int, guard: GuardSettings) -> Iterator[States]:
    rng = np.random.default_rng([seed, 7])
    true = Confusions.of(LAYOUT, pattern, error)
    learned = Confusions.learned(LAYOUT, _reports(true, rng))
    planner = BayesPlanner(PRODUCT, OpenGoals.of(PRODUCT), learned)
    for types in LAYOUT.types[rng.integers(len(LAYOUT.types), size=KNOWN)]:
        yield assemble(planner, Guard(PRODUCT, guard), types, true, rng, answers=False)


def _reports(confusions: Confusions, rng: np.random.Generator) -> Iterator[tuple[tuple[str, str], tuple[str, str]]]:
    """Confirmed actions of listed goals: as they were, and as they were reported."""
    names = [(part, position) for part in LAYOUT.parts for position in LAYOUT.positions]
    for _ in range(REPORTS):
        types: Ints = LAYOUT.types[rng.integers(len(LAYOUT.types))]
        position = int(rng.integers(len(types)))
        action = int(types[position]) * len(types) + position
        yield names[action], names[int(rng.choice(len(names), p=confusions.matrix[action]))]


def _cells(states: Iterable[dict[str, bool]]) -> tuple[str, str, str, str]:
    """Acts, wrong share of them with its interval, and the share of states in which the robot acts."""
    states = list(states)
    acts = [state["wrong"] for state in states if state["acts"]]
    low, high = wilson(sum(acts), len(acts))
    share = sum(acts) / max(1, len(acts))
    return str(len(acts)), f"{share:.4f}", f"{low:.4f} - {high:.4f}", f"{len(acts) / max(1, len(states)):.3f}"


def _share(found: Values, name: str) -> str:
    return f"{found[name]:.3f} ({found[f'{name}_low']:.3f} - {found[f'{name}_high']:.3f})"


if __name__ == "__main__":
    main()
