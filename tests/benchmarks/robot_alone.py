"""How well the robot works alone, from pixels: pick and place of lone parts, and fetching out of clutter.

python -m tests.benchmarks.robot_alone pick_and_place --poses 50
python -m tests.benchmarks.robot_alone clutter --scenes 60
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Sequence

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from sim.clutter import ScenePart, sample_clutter
from tests.benchmarks.intervals import wilson
from tests.integration.cell_rig import BENCH, COMMISSION, PRODUCT, Diary, lifted, robot_alone, run_tree

FIRST_SEED = 1000


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["pick_and_place", "clutter"])
    parser.add_argument("--poses", type=int, default=50, help="poses for each part type")
    parser.add_argument("--scenes", type=int, default=60, help="scenes of 3 to 6 parts")
    options = parser.parse_args()
    if options.what == "pick_and_place":
        pick_and_place(options.poses)
    else:
        clutter(options.scenes)


def pick_and_place(poses: int) -> None:
    """Each part type alone in the tray at random poses, put into a random hole; judged by the simulator."""
    rows, failures = [], []
    for part in PRODUCT.parts:
        done = 0
        for number in track(range(poses), description=part, console=Console(stderr=True)):
            reason = place_one(part, FIRST_SEED + number)
            done += reason is None
            if reason is not None:
                failures.append(f"{part}, seed {FIRST_SEED + number}: {reason}")
        rows.append((part, done, poses))
    rows.append(("all", sum(row[1] for row in rows), poses * len(PRODUCT.parts)))
    report("Pick and place of lone parts, poses from the wrist camera", rows, failures)


def place_one(part: str, seed: int) -> str | None:
    """None where the part ended upright in the hole, else what happened."""
    rng = np.random.default_rng(seed)
    position = PRODUCT.positions[int(rng.integers(len(PRODUCT.positions)))]
    with robot_alone(sample_clutter(PRODUCT, BENCH.tray, [part], rng), seed) as cell:
        outcome, diary = run_tree(cell, COMMISSION, "PickAndPlaceOne", {"part": part, "position": position})
        placement = cell.score.placements().get(position)
    if outcome.end == "finished" and placement is not None and placement.part == part and placement.seated:
        return None
    return f"{outcome.reason}, {position} holds {placement}: {last_words(diary)}"


def clutter(scenes: int) -> None:
    """One required part out of 3 to 6; fetched means that it hangs in the gripper at the end."""
    tally: dict[int, list[bool]] = {count: [] for count in (3, 4, 5, 6)}
    failures = []
    for number in track(range(scenes), description="clutter", console=Console(stderr=True)):
        seed, count = FIRST_SEED + number, 3 + number % 4
        reason = fetch_one(count, seed)
        tally[count].append(reason is None)
        if reason is not None:
            failures.append(f"{count} parts, seed {seed}: {reason}")
    rows = [(f"{count} parts", sum(results), len(results)) for count, results in tally.items()]
    rows.append(("all", sum(row[1] for row in rows), scenes))
    report("Required parts fetched out of clutter", rows, failures)


def fetch_one(count: int, seed: int) -> str | None:
    """None where the required part was fetched, else what happened."""
    scene, part = scene_and_requirement(count, seed)
    with robot_alone(scene, seed) as cell:
        outcome, diary = run_tree(cell, COMMISSION, "FetchPart", {"part": part})
        held = lifted(cell, part)
    return None if held else f"{part} not fetched ({outcome.reason}): {last_words(diary)}"


def scene_and_requirement(count: int, seed: int) -> tuple[tuple[ScenePart, ...], str]:
    """A random scene and the type that is required of it."""
    rng = np.random.default_rng(seed)
    names = list(PRODUCT.parts)
    types = [names[i] for i in rng.integers(len(names), size=count)]
    return sample_clutter(PRODUCT, BENCH.tray, types, rng), types[0]


def last_words(diary: Diary) -> str:
    """The last things that nodes said, and the solutions that were decoded."""
    solutions = Counter(str(fields["solution"]) for _, _, fields in diary.notes if "solution" in fields)
    return f"{'; '.join(diary.reasons()[-3:])} (solutions: {dict(solutions)})"


def report(title: str, rows: Sequence[tuple[str, int, int]], failures: Sequence[str]) -> None:
    """A table with 95 % Wilson intervals, and every failure in words."""
    table = Table("", "done", "of", "share", "95 % interval", title=title)
    for name, done, total in rows:
        low, high = wilson(done, total)
        table.add_row(name, str(done), str(total), f"{done / max(total, 1):.3f}", f"{low:.3f} - {high:.3f}")
    console = Console()
    console.print(table)
    for failure in failures:
        console.print(failure, highlight=False, soft_wrap=True)


if __name__ == "__main__":
    main()
