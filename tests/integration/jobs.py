"""The example jobs on the simulated cell, from pixels: one seed each, and what is then true.

Run it: python -m tests.integration.jobs palletise --seeds 20 --first-seed 100
"""

from __future__ import annotations

import argparse
import csv
import math
import os
import shutil
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from bracket_cell.skills.motion.grasp_pose import hole_pose
from bracket_sim.scene.clutter import full_set, sample_clutter
from bracket_sim.scene.parts import ScenePart
from tests import ROOT
from tests.integration.cell_rig import (
    BENCH,
    CONFIGURATION,
    PRODUCT,
    SIMULATION,
    robot_alone,
    run_tree,
)

JOBS = ROOT / "trees" / "jobs"
NEAR_M = 0.015  # a part that stands this near to its spot stands there


@contextmanager
def folder() -> Iterator[Path]:
    """An empty working folder, with the order beside the tree as in a clone."""
    before = Path.cwd()
    with tempfile.TemporaryDirectory() as name:
        shutil.copytree(JOBS, Path(name) / "trees" / "jobs")
        os.chdir(name)
        try:
            yield Path(name)
        finally:
            os.chdir(before)


def clutter(seed: int) -> tuple[ScenePart, ...]:
    """One product's parts in the tray."""
    return sample_clutter(PRODUCT, BENCH.tray, full_set(PRODUCT), np.random.default_rng(seed), SIMULATION.clutter)


def palletise(seed: int) -> str | None:
    """None where every type stands in its row, else what is wrong."""
    with robot_alone(clutter(seed), seed) as cell:
        outcome, recorded = run_tree(cell, JOBS / "palletise.xml")
        rows: dict[str, list[tuple[float, float]]] = {part: [] for part in PRODUCT.parts}
        for body in cell.world.bodies:
            x, y, _ = cell.world.part_pose(body).position_m
            rows[body.part].append((x, y))
    for row, (part, places) in enumerate(rows.items()):
        wanted = [(0.28 + 0.10 * column, 0.44 + 0.10 * row) for column in range(len(places))]
        for place in wanted:
            if min(math.dist(place, found) for found in places) > NEAR_M:
                return f"no {part} at {place}; {outcome.reason}; {recorded.reasons()[-3:]}"
    return None if outcome.end == "finished" else f"{outcome.reason}; {recorded.reasons()[-3:]}"


def kit(seed: int) -> str | None:
    """None where every row of the order stands at its spot."""
    with folder(), robot_alone(clutter(seed), seed) as cell:
        outcome, recorded = run_tree(cell, JOBS / "kit.xml")
        bodies = [(body.part, cell.world.part_pose(body).position_m[:2]) for body in cell.world.bodies]
    with (JOBS / "order.csv").open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            x, y = (float(word) for word in row["spot"].split(":")[1].split()[:2])
            if not any(part == row["part"] and math.dist(place, (x, y)) < NEAR_M for part, place in bodies):
                return f"no {row['part']} at {row['spot']}; {outcome.reason}; {recorded.reasons()[-3:]}"
    return None if outcome.end == "finished" else outcome.reason


def inspect(seed: int) -> str | None:
    """None where the report says of every hole what is in it."""
    rng = np.random.default_rng(seed)
    types = list(rng.permutation(full_set(PRODUCT)))
    truth = {p: types.pop() if rng.random() < 0.7 else "empty" for p in PRODUCT.positions}
    scene = [ScenePart(part, hole_pose(PRODUCT, BENCH, p)) for p, part in truth.items() if part != "empty"]
    with folder() as here, robot_alone(scene, seed) as cell:
        outcome, recorded = run_tree(cell, JOBS / "inspect.xml")
        report = here / "inspection.csv"
        rows = list(csv.DictReader(report.read_text().splitlines())) if report.exists() else []
    if outcome.end != "finished":
        return f"{outcome.reason}; {recorded.reasons()[-3:]}"
    seen = {row["position"]: row["seen"] for row in rows}
    goal = PRODUCT.goal_placements("g0")
    judged = {row["position"]: row["right"] == "true" for row in rows}
    right = {p: truth[p] == goal[p] for p in truth}
    return None if (seen, judged) == (truth, right) else f"reported {seen}, true is {truth}"


def teach(seed: int) -> str | None:
    """None where the file of goals then holds what the person assembled."""
    rng = np.random.default_rng(seed)
    shown = tuple(str(part) for part in rng.permutation(full_set(PRODUCT)))
    product = PRODUCT.model_validate({**PRODUCT.model_dump(), "goals": PRODUCT.goals | {"secret": shown}})
    if shown in PRODUCT.goals.values():
        return None
    return _teach(seed, product, shown)


def _teach(seed: int, product: object, shown: tuple[str, ...]) -> str | None:
    from bracket_cell.learned.semantic.goals import OpenGoals
    from tests.integration import cell_rig

    with folder() as here:
        path = here / "goals.yaml"
        semantic = CONFIGURATION.planners.semantic.model_copy(update={"goals": path})
        planners = CONFIGURATION.planners.model_copy(update={"semantic": semantic})
        configuration = CONFIGURATION.model_copy(update={"planners": planners})
        with cell_rig.person_who_knows(product, "secret", seed) as cell:  # type: ignore[arg-type]
            outcome, recorded = run_tree(cell, JOBS / "teach.xml", configuration=configuration)
        learned = OpenGoals.load(path, PRODUCT).learned
    if outcome.end != "finished":
        return f"{outcome.reason}; {recorded.reasons()[-3:]}"
    return None if [goal.parts for goal in learned.values()] == [shown] else f"learned {learned}, shown was {shown}"


ALL: dict[str, Callable[[int], str | None]] = {
    "palletise": palletise,
    "kit": kit,
    "inspect": inspect,
    "teach": teach,
}


def main() -> None:
    """Run one job on several seeds and count."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("job", choices=ALL)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--first-seed", type=int, default=0)
    options = parser.parse_args()
    results: Counter[bool] = Counter()
    for seed in range(options.first_seed, options.first_seed + options.seeds):
        began = time.process_time()
        wrong = ALL[options.job](seed)
        results[wrong is None] += 1
        print(f"{options.job} {seed}: {wrong or 'right'} ({time.process_time() - began:.0f} s of CPU)", flush=True)
    print(f"{options.job}: {results[True]} of {options.seeds}")


if __name__ == "__main__":
    main()
