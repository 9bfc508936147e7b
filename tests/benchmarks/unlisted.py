"""Assemblies of a goal that nobody listed, where only the robot has two types of its parts: it must ask where they go.

python -m tests.benchmarks.unlisted --runs 10 --first-seed 0
Nothing is rendered. Without an answer no such assembly can finish.
"""

from __future__ import annotations

import argparse
import json
from typing import Any

from cell.configuration import for_shift, load_faults
from cell.evaluating.bare_host import without_pixels
from cell.run import drive
from cell.run_options import Files
from cell.running.node_library import node_registry
from cell.running.operator import OperatorChannel
from cell.running.services import load_planners
from sim.cell import SimCell
from sim.jobs import RANDOM_GOAL
from tests.integration.cell_rig import ASSEMBLE, BENCH, CAN, CONFIGURATION, PRODUCT, Diary, motion_planner
from trees.files.loader import load_tree


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--first-seed", type=int, default=0)
    options = parser.parse_args()
    rows = []
    for seed in range(options.first_seed, options.first_seed + options.runs):
        rows.append(unlisted(seed))
        print(json.dumps(rows[-1]), flush=True)
    print(f"{sum(row['finished'] and row['correct'] for row in rows)} of {len(rows)} finished and are right")


def unlisted(seed: int) -> dict[str, Any]:
    """One assembly; the type that the person has follows from the seed."""
    kept = list(PRODUCT.parts)[seed % len(PRODUCT.parts)]
    configuration = for_shift(CONFIGURATION, 2)  # with a person who answers, and twice the time of one assembly
    settings = configuration.devices.simulation
    habits = settings.person.shift.model_copy(update={"new_goals": 1.0})
    person = settings.person.model_copy(update={"shift": habits})
    settings = settings.model_copy(update={"person": person})
    cell = SimCell(PRODUCT, BENCH, settings, *CAN, seed, RANDOM_GOAL, rendered=False)
    try:
        cell.stock.take([body for body in cell.world.bodies if body.owner == "person" and body.part != kept])
        diary = Diary()
        files = Files(
            configuration,
            PRODUCT,
            load_tree(ASSEMBLE, node_registry(PRODUCT)),
            load_planners(CONFIGURATION, PRODUCT),
            load_faults(CONFIGURATION),
        )
        operator = OperatorChannel(PRODUCT.goals, present=True)
        outcome = drive(files, without_pixels(cell), motion_planner(), (diary,), operator=operator)
        report = cell.report()
    finally:
        cell.close()
    asked = [(round(time_s, 1), fields.get("text")) for time_s, topic, fields in diary.notes if topic == "help"]
    return {
        "seed": seed,
        "person_has": kept,
        "finished": outcome.end == "finished",
        "correct": report["correct"],
        "reason": outcome.reason,
        "robot": report["robot_placements"],
        "sim_time_s": round(outcome.sim_time_s, 1),
        "asked": asked,
    }


if __name__ == "__main__":
    main()
