"""Whole assemblies by `cell run` under every look and beside every person, as a table.

python -m tests.benchmarks.baseline --runs 6 --first-seed 700 --out runs/baseline.jsonl
python -m tests.benchmarks.baseline --runs 0 --out runs/baseline.jsonl     # the table of what is there
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Sequence
from itertools import product
from pathlib import Path

from rich.console import Console

from cell.configuration import load_configuration, load_product
from tests import ROOT
from tests.benchmarks.assembly import Run, assemble, verdict
from tests.benchmarks.overlap import configuration

LOOKS, PERSONS = ("nominal", "varied", "hard"), ("careful", "ordinary", "careless")
FAST_M_S = 0.25
COLUMNS = (
    "look",
    "person",
    "runs",
    "finished and right",
    "right in the bracket",
    "wrong placements",
    "parts by the robot",
    "calls for help",
    "runs with a contact, fast",
    "simulated time",
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=6, help="for each look and person")
    parser.add_argument("--first-seed", type=int, default=700)
    parser.add_argument("--looks", nargs="+", default=LOOKS)
    parser.add_argument("--persons", nargs="+", default=PERSONS)
    parser.add_argument("--max-duration-s", type=float, default=90.0, help="end runs after so much simulated time")
    parser.add_argument("--out", type=Path, required=True, help="one line of JSON for each run; more are appended")
    options = parser.parse_args()
    goals = sorted(load_product(load_configuration()).goals)
    console = Console(stderr=True)
    with tempfile.TemporaryDirectory() as folder:
        config = configuration(ROOT, Path(folder) / "cell.yaml", False, options.max_duration_s)
        for seed in range(options.first_seed, options.first_seed + options.runs):
            for look, person in product(options.looks, options.persons):
                run = assemble(goals[seed % len(goals)], seed, person, ("--look", look, "--config", str(config)))
                with options.out.open("a") as stream:
                    stream.write(json.dumps({**run, "look": look, "person": person}) + "\n")
                console.print(f"{look}, {person}, seed {seed}: {verdict(run)}", highlight=False)
    runs = [json.loads(line) for line in options.out.read_text().splitlines()]
    print(f"| {' | '.join(COLUMNS)} |\n|{'---|' * len(COLUMNS)}")
    for look, person in product(LOOKS, PERSONS):
        if chosen := [run for run in runs if (run["look"], run["person"]) == (look, person)]:
            print(row(look, person, chosen))


def row(look: str, person: str, runs: Sequence[Run]) -> str:
    """One line of the table."""
    right = [run for run in runs if run["correct"]]
    touched = [run for run in runs if run.get("contacts")]
    fast = sum(run["contact_speed_m_s"] > FAST_M_S for run in touched)
    cells = (
        look,
        person,
        len(runs),
        sum(run["end"] == "finished" for run in right),
        len(right),
        _total(runs, "wrong_placements"),
        f"{_total(runs, 'robot_placements') / len(runs):.1f}",
        _total(runs, "help_requests"),
        f"{len(touched)}, {fast}",
        f"{_total(runs, 'sim_time_s') / len(runs):.0f} s",
    )
    return f"| {' | '.join(map(str, cells))} |"


def _total(runs: Sequence[Run], name: str) -> float:
    total = sum(float(run.get(name) or 0) for run in runs)
    return int(total) if total == int(total) else total


if __name__ == "__main__":
    main()
