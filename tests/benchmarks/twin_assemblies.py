"""Whole assemblies through the wires of all devices, against the twin: how many are right, and what stopped the others.

    python -m tests.benchmarks.twin_assemblies --runs 10 --slower 16 --out runs/twin

With `--ros2` it tells as well how late joints and images came, and the first motion after a command. Folders keep
log, screen and configuration of each run. An assembly takes about 45 s of the cell.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.fleet.intervals import wilson
from tests.benchmarks.ros_delays import listened, summary
from tests.benchmarks.wired_cell import Told, wired_cell
from tests.sim.twin.rig import own_host

LONGEST_S = 320.0  # of the cell; the run itself ends after 300 s


def main() -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=10, help="shared out among the goals")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--slower", type=float, default=16.0, help="the cell goes so many times slower")
    parser.add_argument("--person", default="careful", help="who stands at the bench")
    parser.add_argument("--out", type=Path, default=Path("runs/twin"), help="a folder for each seed, and results.jsonl")
    parser.add_argument("--ros2", type=int, metavar="DOMAIN", help="by topics of ROS 2 in place of the wires")
    parser.add_argument("--robot", type=Path, help="file of another arm than the shipped one")
    asked = parser.parse_args()
    goals = sorted(load_product(load_configuration()).goals)
    asked.out.mkdir(parents=True, exist_ok=True)
    for seed in range(asked.first_seed, asked.first_seed + asked.runs):
        told = assembled(
            *(asked.out.resolve() / str(seed), seed, goals[seed % len(goals)], asked.person, asked.slower),
            *(asked.ros2, asked.robot),
        )
        with (asked.out / "results.jsonl").open("a") as stream:
            stream.write(json.dumps(told) + "\n")
    rows = [json.loads(line) for line in (asked.out / "results.jsonl").read_text().splitlines()]
    Console().print(table(rows))
    for name in dict.fromkeys(name for row in rows for name in row.get("delays", ())):
        late = [delay for row in rows for delay in row.get("delays", {}).get(name, ())]
        Console().print(*summary({name: late}))


def assembled(
    folder: Path,
    seed: int,
    goal: str,
    person: str,
    slower: float,
    domain: int | None = None,
    robot: Path | None = None,
) -> Told:
    """One assembly: what the run told, and by the twin's truth what was built."""
    more = ("--seed", str(seed), "--goal", goal, "--person", person)
    began_s = time.monotonic()
    with wired_cell(folder, own_host(1), slower, more, domain, robot) as cell:
        with listened(domain) as delays:
            run = cell.run(LONGEST_S)
        told = {"seed": seed, "slower": slower, "wall_s": time.monotonic() - began_s, "run": run}
        return told | {
            "twin": cell.report(),
            "delays": {name: np.round(late, 5).tolist() for name, late in delays.items()},
        }


def table(rows: list[Told]) -> Table:
    """A line for each run."""
    right = sum(bool(row["twin"]["correct"]) and row["run"]["end"] == "finished" for row in rows)
    shown = Table("seed", "goal", "K", "right", "end", "by the robot", "cell s", "world lost s", "wall s")
    share = wilson(right, len(rows))
    shown.title = f"{right} of {len(rows)} assemblies through the wires (95 %: {share.low:.2f} to {share.high:.2f})"
    for row in rows:
        run, twin = row["run"], row["twin"]
        end = run["end"] if run["end"] == "finished" else f"{run['end']}: {run.get('reason', '')}"
        took_s, lost_s = run.get("sim_time_s") or twin["time_s"], twin["lost_s"]
        shown.add_row(
            *(str(row["seed"]), twin["goal"], f"{row['slower']:g}", "yes" if twin["correct"] else "no", end),
            *(str(twin["robot_placements"]), f"{took_s:.0f}", f"{lost_s:.2f}", f"{row['wall_s']:.0f}"),
        )
    return shown


if __name__ == "__main__":
    main()
