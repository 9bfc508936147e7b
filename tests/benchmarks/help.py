"""Assemblies in which one type of part is neither in the tray nor in the bins until somebody helps.

python -m tests.benchmarks.help --runs 30 [--tree trees/assemble.xml]
The robot must ask; the person notices after 10 s on average and sets the part into the tray. Without that answer no
such assembly can finish.
"""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import Any

from bracket_cell.running.operator import OperatorChannel
from tests import ROOT
from tests.benchmarks.asking import assembled, tell_each
from tests.integration.cell_rig import PRODUCT, with_person

AHEAD = ROOT / "trees" / "ahead.xml"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=30)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--tree", type=Path, default=AHEAD)
    options = parser.parse_args()
    seeds = range(options.first_seed, options.first_seed + options.runs)
    tell_each(seeds, partial(without_a_part, path=options.tree))


def without_a_part(seed: int, path: Path = AHEAD) -> dict[str, Any]:
    """One assembly; the type that is missing follows from the seed."""
    goal = sorted(PRODUCT.goals)[seed % len(PRODUCT.goals)]
    missing = list(PRODUCT.parts)[(seed // len(PRODUCT.goals)) % len(PRODUCT.parts)]
    with with_person(goal, seed) as cell:
        cell.stock.take([body for body in cell.world.bodies if body.part == missing])
        row = assembled(cell, cell.devices, path, OperatorChannel(PRODUCT.goals))
    return {"seed": seed, "missing": missing, **row}


if __name__ == "__main__":
    main()
