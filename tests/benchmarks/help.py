"""Assemblies in which one type of part is neither in the tray nor in the bins until somebody helps.

python -m tests.benchmarks.help --runs 30 [--tree trees/assemble.xml]
The robot must ask; the person notices after 10 s on average and sets the part into the tray. Without that answer no
such assembly can finish.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from cell.configuration import load_faults
from cell.run import drive
from cell.run_options import Files
from cell.running.node_library import node_registry
from cell.running.operator import OperatorChannel
from cell.running.services import load_planners
from tests import ROOT
from tests.integration.cell_rig import CONFIGURATION, PRODUCT, Diary, motion_planner, with_person
from trees.files.loader import load_tree

AHEAD = ROOT / "trees" / "ahead.xml"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=30)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--tree", type=Path, default=AHEAD)
    options = parser.parse_args()
    rows = []
    for seed in range(options.first_seed, options.first_seed + options.runs):
        rows.append(without_a_part(seed, options.tree))
        print(json.dumps(rows[-1]), flush=True)
    print(f"{sum(row['finished'] and row['correct'] for row in rows)} of {len(rows)} finished and are right")


def without_a_part(seed: int, path: Path = AHEAD) -> dict[str, Any]:
    """One assembly; the type that is missing follows from the seed."""
    goal = sorted(PRODUCT.goals)[seed % len(PRODUCT.goals)]
    missing = list(PRODUCT.parts)[(seed // len(PRODUCT.goals)) % len(PRODUCT.parts)]
    with with_person(goal, seed) as cell:
        cell.stock.take([body for body in cell.world.bodies if body.part == missing])
        diary = Diary()
        tree = load_tree(path, node_registry(PRODUCT))
        planners, faults = load_planners(CONFIGURATION, PRODUCT), load_faults(CONFIGURATION)
        files = Files(CONFIGURATION, PRODUCT, tree, planners, faults)
        outcome = drive(files, cell.devices, motion_planner(), (diary,), operator=OperatorChannel(PRODUCT.goals))
        report = cell.report()
        asked = [(round(time_s, 1), fields.get("text")) for time_s, topic, fields in diary.notes if topic == "help"]
        return {
            "seed": seed,
            "missing": missing,
            "finished": outcome.end == "finished",
            "correct": report["correct"],
            "reason": outcome.reason,
            "robot": report["robot_placements"],
            "help_requests": len(asked),
            "first_asked_s": asked[0][0] if asked else None,
            "sim_time_s": round(outcome.sim_time_s, 1),
            "asked": asked[:4],
        }


if __name__ == "__main__":
    main()
