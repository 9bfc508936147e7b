"""Assemblies of a goal that nobody listed, where only the robot has two types of its parts: it must ask where they go.

python -m tests.benchmarks.unlisted --runs 10 --first-seed 0
Nothing is rendered. Without an answer no such assembly can finish.
"""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import Any

from bracket_cell.configuration import DEFAULT_TREE, for_shift
from bracket_cell.running.operator import OperatorChannel
from bracket_sim.cell import SimCell
from bracket_sim.process.no_render_host import without_pixels
from bracket_sim.scene.jobs import RANDOM_GOAL
from bracket_sim.scene.settings import settings_of
from tests.benchmarks.asking import assembled, tell_each
from tests.integration.cell_rig import BENCH, CAN, CONFIGURATION, PRODUCT


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--tree", type=Path, default=DEFAULT_TREE)
    options = parser.parse_args()
    seeds = range(options.first_seed, options.first_seed + options.runs)
    tell_each(seeds, partial(unlisted, path=options.tree))


def unlisted(seed: int, path: Path = DEFAULT_TREE) -> dict[str, Any]:
    """One assembly; the type that the person has follows from the seed."""
    kept = list(PRODUCT.parts)[seed % len(PRODUCT.parts)]
    configuration = for_shift(CONFIGURATION, 2)  # with a person who answers, and twice the time of one assembly
    settings = settings_of(configuration.devices.simulation)
    habits = settings.person.shift.model_copy(update={"new_goals": 1.0})
    person = settings.person.model_copy(update={"shift": habits})
    settings = settings.model_copy(update={"person": person})
    cell = SimCell(PRODUCT, BENCH, settings, *CAN, seed, RANDOM_GOAL, rendered=False)
    try:
        cell.stock.take([body for body in cell.world.bodies if body.owner == "person" and body.part != kept])
        operator = OperatorChannel(PRODUCT.goals, present=True)
        row = assembled(cell, without_pixels(cell, configuration, PRODUCT), path, operator, configuration)
    finally:
        cell.close()
    return {"seed": seed, "person_has": kept, **row}


if __name__ == "__main__":
    main()
