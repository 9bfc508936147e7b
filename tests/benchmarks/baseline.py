"""Whole assemblies by `cell run` under every look and beside every person, as a table.

Runs that the file has already are not run again: a command that was ended goes on where it stopped.

python -m tests.benchmarks.baseline --runs 6 --first-seed 700 --out runs/baseline.jsonl
python -m tests.benchmarks.baseline --runs 0 --out runs/baseline.jsonl     # the table of what is there
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
import time
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
    parser.add_argument(
        "--out", type=Path, required=True, help="one line of JSON for each run; goes on where it stopped"
    )
    parser.add_argument("--minutes", type=float, default=math.inf, help="begin no run after so many minutes")
    options = parser.parse_args()
    goals = sorted(load_product(load_configuration()).goals)
    console = Console(stderr=True)
    seeds = range(options.first_seed, options.first_seed + options.runs)
    done = {_key(run) for run in _runs(options.out)}
    missing = [key for key in product(seeds, options.looks, options.persons) if key not in done]
    until_s = time.monotonic() + 60 * options.minutes
    with tempfile.TemporaryDirectory() as folder:
        config = configuration(ROOT, Path(folder) / "cell.yaml", False, options.max_duration_s)
        for seed, look, person in missing:
            if time.monotonic() > until_s:
                break
            run = assemble(goals[seed % len(goals)], seed, person, ("--look", look, "--config", str(config)))
            with options.out.open("a") as stream:
                stream.write(json.dumps({**run, "seed": seed, "look": look, "person": person}) + "\n")
            console.print(f"{look}, {person}, seed {seed}: {verdict(run)}", highlight=False)
    runs = _runs(options.out)
    print(f"| {' | '.join(COLUMNS)} |\n|{'---|' * len(COLUMNS)}")
    for look, person in product(LOOKS, PERSONS):
        if chosen := [run for run in runs if (run["look"], run["person"]) == (look, person)]:
            print(row(look, person, chosen))


def _runs(path: Path) -> list[Run]:
    """Those of the file; a last line that was cut off is dropped from it."""
    lines = path.read_text().splitlines(keepends=True) if path.exists() else []
    if lines and not lines[-1].endswith("\n"):
        path.write_text("".join(lines[:-1]))
    return [json.loads(line) for line in lines if line.endswith("\n")]


def _key(run: Run) -> tuple[int, str, str]:
    return int(run["seed"]), run["look"], run["person"]


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
