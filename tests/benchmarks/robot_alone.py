"""How well the robot works alone, from pixels: pick and place of lone parts, and fetching out of clutter and stacks.

python -m tests.benchmarks.robot_alone pick_and_place --seeds 1000:1050
python -m tests.benchmarks.robot_alone pick_and_place --seeds 1000:1010 --nobody
python -m tests.benchmarks.robot_alone clutter --seeds 1000:1100 --planner pairwise --from tray
python -m tests.benchmarks.robot_alone clutter --seeds 1000:1010 --config config/paper.yaml --from blocked --out FILE
python -m tests.benchmarks.robot_alone stacks --seeds 1000:1060
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table
from scipy.stats import t as t_distribution

from bracket_cell.commands.options import seeds_of
from bracket_cell.configuration import DEFAULT_CONFIGURATION, Configuration, load_configuration
from bracket_cell.fleet.intervals import wilson
from bracket_cell.kinds import WEIGHTS
from bracket_ground.files.row_store import RowStore
from bracket_ground.interfaces.planning import crops_file
from bracket_lab.evaluations.assembly import OF_PERSON
from bracket_sim.scene.clutter import sample_clutter
from tests.benchmarks import clearing, clearing_stacks
from tests.integration.cell_rig import BENCH, COMMISSION, PRODUCT, robot_alone, run_tree

SCENES = {
    "tray": clearing.tray_scene,
    "paper": clearing.paper_scene,
    "dense": clearing.dense_scene,
    "blocked": clearing.blocked_scene,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["pick_and_place", "clutter", "stacks"])
    parser.add_argument(
        "--seeds", type=seeds_of, default="1000:1025", help="a scene each; of clutter, one of each size"
    )
    parser.add_argument("--out", type=Path, help="file that keeps scenes of clutter; interrupted, it goes on there")
    parser.add_argument("--json", action="store_true", help="of clutter, print the shares as JSON, too")
    parser.add_argument("--config", type=Path, default=DEFAULT_CONFIGURATION, help="of the cell that fetches")
    parser.add_argument("--planner", help="kind of grasp planner; as configured by default")
    parser.add_argument("--from", dest="source", choices=SCENES, default="tray", help=" / ".join(SCENES))
    parser.add_argument("--nobody", action="store_true", help="of pick_and_place: the arm waits for no person")
    options = parser.parse_args()
    configuration = load_configuration(options.config)
    if options.what == "pick_and_place":
        with TemporaryDirectory() as folder:
            pick_and_place(options.seeds, unguarded(configuration, Path(folder)) if options.nobody else configuration)
        return
    if options.planner is not None:
        configuration = with_planner(configuration, options.planner)
    who = f"{configuration.planners.grasp.kind}, {configuration.perception.words}"
    if options.what == "stacks":
        clearing_stacks.report(f"Stacks: {who}", clearing_stacks.run_scenes(options.seeds, configuration))
        return
    store = RowStore(options.out, ["size", "seed"], {"who": who, "from": options.source})
    cases = clearing.run_scenes(SCENES[options.source], options.seeds, configuration, store)
    clearing.report(f"Algorithm 2 executed: {who}, {options.source} scenes", cases)
    if options.json:
        print(json.dumps({"who": who, "sizes": clearing.shares(cases)}))


def pick_and_place(seeds: Sequence[int], configuration: Configuration) -> None:
    """Each part type alone in the tray at random poses, put into a random hole; judged by the simulator."""
    rows, failures, times_s = [], [], []
    for part in PRODUCT.parts:
        done = 0
        for seed in track(seeds, description=part, console=Console(stderr=True)):
            try:
                times_s.append(place_one(part, seed, configuration))
                done += 1
            except NotPlaced as reason:
                failures.append(f"{part}, seed {seed}: {reason}")
        rows.append((part, done, len(seeds)))
    rows.append(("all", sum(row[1] for row in rows), len(seeds) * len(PRODUCT.parts)))
    report("Pick and place of lone parts, poses from the wrist camera", rows, failures)
    if len(times_s) > 1:
        mean_s, error_s = np.mean(times_s), np.std(times_s, ddof=1) / np.sqrt(len(times_s))
        low_s, high_s = t_distribution.interval(0.95, len(times_s) - 1, mean_s, error_s)
        Console().print(f"from the arm's start to the part let go: {mean_s:.2f} s ({low_s:.2f} to {high_s:.2f})")


def place_one(part: str, seed: int, configuration: Configuration) -> float:
    """How long it took [s], from the first motion towards the part until it was let go.

    Raises:
        NotPlaced: it does not stand upright in the hole.
    """
    rng = np.random.default_rng(seed)
    position = PRODUCT.positions[int(rng.integers(len(PRODUCT.positions)))]
    with robot_alone(sample_clutter(PRODUCT, BENCH.tray, [part], rng), seed) as cell:
        provided = {"part": part, "position": position}
        outcome, events = run_tree(cell, COMMISSION, "PickAndPlaceOne", provided, configuration=configuration)
        placement = cell.score.placements().get(position)
    if outcome.end != "finished" or placement is None or placement.part != part or not placement.seated:
        raise NotPlaced(f"{outcome.reason}, {position} holds {placement}: {clearing.last_words(events)}")
    said = [(str(fields.get("reason")), time_s) for time_s, topic, fields in events.notes if topic == "skill"]
    starts_s = next(time_s for reason, time_s in said if reason.startswith("moving above"))
    return next(time_s for reason, time_s in reversed(said) if "was let go" in reason) - starts_s


class NotPlaced(Exception):
    """What happened instead."""


def unguarded(configuration: Configuration, folder: Path) -> Configuration:
    """The same for a place where nobody can come: the supervisor only notes where hands are."""
    table = folder / "faults.yaml"
    rows = "".join(f"  - {{signal: {signal}, action: run, clear: itself}}\n" for signal in OF_PERSON)
    table.write_text(f"extends: shipped\nfaults:\n{rows}")
    return configuration.model_copy(update={"faults": table})


def with_planner(configuration: Configuration, kind: str) -> Configuration:
    """The same with another kind of grasp planner and its shipped weights."""
    weights = WEIGHTS / f"grasp_{kind}.onnx"
    grasp = configuration.planners.grasp.model_copy(update={"kind": kind, "weights": weights})
    planners = configuration.planners.model_copy(update={"grasp": grasp})
    crops = crops_file(weights) if kind == "paper" else None
    perception = configuration.perception.model_copy(update={"crops": crops})
    return configuration.model_copy(update={"planners": planners, "perception": perception})


def report(title: str, rows: Sequence[tuple[str, int, int]], failures: Sequence[str]) -> None:
    """A table with 95 % Wilson intervals, and every failure in words."""
    table = Table("", "done", "of", "share", "95 % interval", title=title)
    for name, done, total in rows:
        low, _, high = wilson(done, total)
        table.add_row(name, str(done), str(total), f"{done / max(total, 1):.3f}", f"{low:.3f} - {high:.3f}")
    console = Console()
    console.print(table)
    for failure in failures:
        console.print(failure, highlight=False, soft_wrap=True)


if __name__ == "__main__":
    main()
