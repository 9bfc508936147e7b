"""Compares the labels of stacks with really lifting: other speeds, finer steps, and all that lies on top taken first.

python -m tests.benchmarks.stack_labels --trials 500

In each trial one object of a drawn stack is lifted by 60 mm. Whatever else moves by more than 3 mm must be labelled as
lying on it, and nothing else may be. Then what is labelled so is taken away, children first, each with nothing else
moving, and at last the object itself.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from bracket_cell.fleet.intervals import wilson
from bracket_lab.stacks.draw import LIFT_M, MOVED_M, Rests, Standing, stand
from bracket_sim.stacks.settings import StackSettings

FINE_STEP_S = 0.001
SPEEDS_M_S = (0.08, 0.30)
SETTLE_S = 0.3  # after each one that is taken away
BAR = 0.99


def order_of_taking(rests: Rests, wanted: int) -> Sequence[int]:
    """What is to be taken before an object, in an order that works: what lies on top goes first."""
    left = set(np.flatnonzero(rests[:, wanted]).tolist())
    order: list[int] = []
    while left:
        free = min(thing for thing in left if not rests[list(left), thing].any())
        order.append(free)
        left.remove(free)
    return order


@dataclass(frozen=True)
class Trial:
    """What lifting one object showed.

    Attributes:
        pairs: of each other object, whether label and lifting say the same.
        order: whether all could be taken in the labelled order with nothing else moving.
    """

    where: str
    pairs: tuple[bool, ...]
    order: bool

    @property
    def agrees(self) -> bool:
        return all(self.pairs)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=500)
    parser.add_argument("--seed", type=int, default=7)
    options = parser.parse_args()
    numbers = track(range(options.trials), description="lifting", console=Console(stderr=True))
    report([lifted(number, options.seed) for number in numbers])


def lifted(number: int, seed: int) -> Trial:
    """Lift an object at random of a stack, and then take it in the labelled order."""
    rng = np.random.default_rng([seed, number, 31])
    standing = stand(number, StackSettings(), seed)
    stage, wanted = standing.stage, int(rng.integers(len(standing.names)))
    stage.model.opt.timestep = FINE_STEP_S
    before = stage.state()
    moved = stage.lift(wanted, LIFT_M, rng.uniform(*SPEEDS_M_S)) > MOVED_M
    stage.restore(before)
    others = [one for one in range(len(standing.names)) if one != wanted]
    pairs = tuple(bool(moved[other] == standing.rests[other, wanted]) for other in others)
    where = f"stack {number}: {standing.names[wanted]} of {', '.join(standing.names)}"
    return Trial(where, pairs, _taken_in_order(standing, wanted, rng))


def _taken_in_order(standing: Standing, wanted: int, rng: np.random.Generator) -> bool:
    """Whether nothing but what is taken moves."""
    stage = standing.stage
    for one in (*order_of_taking(standing.rests, wanted), wanted):
        moved = stage.lift(one, LIFT_M, rng.uniform(*SPEEDS_M_S))
        stage.take_away(one)
        stage.run(SETTLE_S)
        others = [other for other, down in enumerate(stage.down) if down]
        if (moved[others] > MOVED_M).any():
            return False
    return True


def report(trials: list[Trial]) -> None:
    """Agreement with its interval, and all disagreements."""
    pairs = Counter(pair for trial in trials for pair in trial.pairs)
    rows = {
        "pairs of objects": (pairs[True], pairs.total()),
        "objects, all others right": (sum(trial.agrees for trial in trials), len(trials)),
        "taken in the labelled order": (sum(trial.order for trial in trials), len(trials)),
    }
    table = Table("what", "agree", "of", "share", "95 % interval", f"bar {BAR}")
    for name, (right, count) in rows.items():
        low, share, high = wilson(right, count)
        met = "met" if share >= BAR else "missed"
        table.add_row(name, str(right), str(count), f"{share:.4f}", f"{low:.4f} - {high:.4f}", met)
    console = Console()
    console.print(table)
    for trial in trials:
        if not (trial.agrees and trial.order):
            console.print(f"{trial.where}: pairs {trial.pairs}, order {trial.order}", highlight=False, soft_wrap=True)


if __name__ == "__main__":
    main()
