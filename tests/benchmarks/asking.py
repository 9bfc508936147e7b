"""What the benchmarks share in which the robot must ask: an assembly beside somebody who answers, and its row."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from bracket_cell.configuration import Configuration, load_faults
from bracket_cell.running.operator import OperatorChannel
from bracket_cell.runs.options import Files
from bracket_cell.runs.run import run_controller
from bracket_cell.trees.loading import load_tree
from bracket_cell.trees.node_library import node_registry
from bracket_cell.wiring.devices import attached
from bracket_cell.wiring.services import load_planners
from bracket_ground.interfaces.devices import Devices
from bracket_sim.cell import SimCell
from tests.integration.cell_rig import CONFIGURATION, PRODUCT, Recorded, motion_planner


def assembled(
    cell: SimCell,
    devices: Devices,
    tree: Path,
    operator: OperatorChannel,
    configuration: Configuration = CONFIGURATION,
) -> dict[str, Any]:
    """Run the tree to its end: how it ended, and what was asked when."""
    events = Recorded()
    planners, faults = load_planners(CONFIGURATION, PRODUCT), load_faults(CONFIGURATION)
    files = Files(configuration, PRODUCT, load_tree(tree, node_registry(PRODUCT)), planners, faults)
    with attached(configuration, PRODUCT, devices) as opened:
        outcome = run_controller(files, opened, motion_planner(), (events,), operator=operator)
    report = cell.report()
    asked = [(round(time_s, 1), fields.get("text")) for time_s, topic, fields in events.notes if topic == "help"]
    return {
        "finished": outcome.end == "finished",
        "correct": report["correct"],
        "reason": outcome.reason,
        "robot": report["robot_placements"],
        "help_requests": len(asked),
        "first_asked_s": asked[0][0] if asked else None,
        "sim_time_s": round(outcome.sim_time_s, 1),
        "asked": asked,
    }


def tell_each(seeds: Iterable[int], assembly: Callable[[int], dict[str, Any]]) -> None:
    """Print a row a seed, then how many are right."""
    rows = []
    for seed in seeds:
        rows.append(assembly(seed))
        print(json.dumps(rows[-1]), flush=True)
    print(f"{sum(row['finished'] and row['correct'] for row in rows)} of {len(rows)} finished and are right")
