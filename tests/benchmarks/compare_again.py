"""How often `cell compare` is right, tried on runs that were recorded: no new run is needed.

python -m tests.benchmarks.compare_again compare/runs.parquet --repetitions 400

Equal trees: in each recorded pair of runs it is drawn by chance which of the two counts as A's, so that A and B are
equal, with the spread of real runs. A known improvement: pairs are drawn again and again from those of the table.
"""

from __future__ import annotations

import argparse
import random
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from bracket_cell.fleet.compare import findings, overall, pair
from bracket_cell.fleet.intervals import wilson
from bracket_cell.fleet.table import read_table

Pair = tuple[Mapping[str, Any], Mapping[str, Any]]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("table", type=Path, help="runs.parquet of a comparison of two trees")
    parser.add_argument("--repetitions", type=int, default=400)
    options = parser.parse_args()
    rows = read_table(options.table)
    one, other = list(dict.fromkeys(row["tree"] for row in rows))[:2]
    pairs = pair(*([row for row in rows if row["tree"] == tree] for tree in (one, other)))
    found = overall(findings(pairs))
    print(f"A {one}, B {other}, {len(pairs)} pairs: {found}")
    draw = random.Random(0)
    equal = [overall(findings(swapped(pairs, draw))) for _ in range(options.repetitions)]
    tell("equal trees, drawn pair by pair", equal, "no difference proved")
    for count in (10, 20, len(pairs)):
        again = [overall(findings(draw.choices(pairs, k=count))) for _ in range(options.repetitions)]
        tell(f"{count} of these pairs, drawn with repetition", again, found)


def swapped(pairs: Sequence[Pair], draw: random.Random) -> list[Pair]:
    """The same pairs, of which by chance some are turned round."""
    return [(b, a) if draw.random() < 0.5 else (a, b) for a, b in pairs]


def tell(what: str, verdicts: Sequence[str], expected: str) -> None:
    share = wilson(verdicts.count(expected), len(verdicts))
    others = ", ".join(f"{count} {name}" for name, count in Counter(verdicts).items() if name != expected) or "nothing"
    span = f"{share.value:.3f} (95 %: {share.low:.3f} - {share.high:.3f})"
    print(f"{what}: '{expected}' in {verdicts.count(expected)} of {len(verdicts)}, {span}; else {others}")


if __name__ == "__main__":
    main()
