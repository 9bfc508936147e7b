"""Whole assemblies by `cell run` under every look and beside every person, with each perception, as a table.

The cameras are calibrated in each look first, by `cell setup calibrate`, as operators do: some hang so far off that
a run would refuse to begin. Runs that the file has already are not run again: a command that was ended goes on where it
stopped.

python -m tests.benchmarks.baseline --runs 6 --first-seed 700 --out runs/baseline.jsonl --minutes 60
python -m tests.benchmarks.baseline --runs 0 --out runs/baseline.jsonl     # the table of what is there
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path

from rich.console import Console

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.log.read.indexed import IndexedLog
from bracket_ground.errors import InputError
from bracket_ground.files.row_store import RowStore
from bracket_lab.evaluations.actions import Told, matched
from tests import ROOT
from tests.benchmarks.assembly import Run, assemble, verdict
from tests.benchmarks.overlap import configuration

PERCEPTIONS = ("classical", "learned")  # as release 0.1.0 had it, and the default
LOOKS, PERSONS = ("nominal", "varied", "hard"), ("careful", "ordinary", "careless")
FAST_M_S = 0.25
KEYS = ("perception", "look", "person")
COLUMNS = (
    *KEYS,
    "runs",
    "finished and right",
    "right in the bracket",
    "wrong placements",
    "parts by the robot",
    "calls for help",
    "runs with a contact, fast",
    "the person's placements told; told wrong",
    "simulated time",
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=6, help="for each perception, look and person")
    parser.add_argument("--first-seed", type=int, default=700)
    parser.add_argument("--perceptions", nargs="+", default=PERCEPTIONS, choices=PERCEPTIONS)
    parser.add_argument("--looks", nargs="+", default=LOOKS)
    parser.add_argument("--persons", nargs="+", default=PERSONS)
    parser.add_argument("--max-duration-s", type=float, default=90.0, help="end runs after so much simulated time")
    parser.add_argument("--out", type=Path, required=True, help="one line of JSON for each run")
    parser.add_argument("--minutes", type=float, default=math.inf, help="begin no run after so many minutes")
    options = parser.parse_args()
    goals = sorted(load_product(load_configuration()).goals)
    console = Console(stderr=True)
    try:
        rows = RowStore(
            options.out, ["seed", *KEYS], {"benchmark": "baseline", "max_duration_s": options.max_duration_s}
        )
    except InputError as error:
        parser.error(str(error))
    seeds = range(options.first_seed, options.first_seed + options.runs)
    until_s = time.monotonic() + 60 * options.minutes
    with tempfile.TemporaryDirectory() as folder:
        config = configuration(ROOT, Path(folder) / "cell.yaml", True, options.max_duration_s)
        for seed, look, person, perception in product(seeds, options.looks, options.persons, options.perceptions):
            if (seed, perception, look, person) in rows or time.monotonic() > until_s:
                continue
            told = config.read_text().replace("kind: learned", f"kind: {perception}")
            told += f"calibration: {calibrated(config, look, seed)}\n"
            (chosen := config.with_name(f"{perception}.yaml")).write_text(told)
            arguments = ("--look", look, "--config", str(chosen))
            run = assemble(goals[seed % len(goals)], seed, person, arguments, noticed)
            rows.add({**run, "seed": seed, "perception": perception, "look": look, "person": person})
            console.print(f"{perception}, {look}, {person}, seed {seed}: {verdict(run)}", highlight=False)
    print(f"| {' | '.join(COLUMNS)} |\n|{'---|' * len(COLUMNS)}")
    for cell in product(PERCEPTIONS, LOOKS, PERSONS):
        if runs := [row for row in rows.rows if tuple(row[key] for key in KEYS) == cell]:
            print(row_of(cell, runs))


def calibrated(config: Path, look: str, seed: int) -> Path:
    """The file of `cell setup calibrate` for a look, made once; raises CalledProcessError where nothing fits."""
    out = config.with_name(f"{look}-{seed}.yaml")
    if not out.exists():
        command = [
            sys.executable,
            "-m",
            "bracket_cell",
            "setup",
            "calibrate",
            "--config",
            str(config),
            "--look",
            look,
        ]
        subprocess.run([*command, "--seed", str(seed), "--out", str(out)], check=True, capture_output=True)
    return out


def noticed(log: Path) -> Mapping[str, int]:
    """What the person put into holes, and what the detectors told of that, by the log of a run."""
    made: list[Told] = []
    told: list[Told] = []
    before: tuple[str, str] | None = None
    for message in IndexedLog(log).messages(topics=("/truth", "/bench")):
        said = json.loads(message.data)
        if message.topic == "/truth":
            if said.get("act") == "release" and said.get("position") is not None:
                made.append((message.time_ns / 1e9, said["part"], said["position"]))
            continue
        action = said["action"]
        now = (action["part"], action["position"]) if action.get("finished") and action.get("position") else None
        if now is not None and now != before:
            told.append((said["time_s"], *now))
        before = now
    return {"placed": len(made), "told": len(told), "told_right": len(matched(made, told))}


def row_of(cell: Sequence[str], runs: Sequence[Run]) -> str:
    """One line of the table."""
    right = [run for run in runs if run["correct"]]
    touched = [run for run in runs if run.get("contacts")]
    fast = sum(run["contact_speed_m_s"] > FAST_M_S for run in touched)
    told_right = _total(runs, "told_right")
    cells = (
        *cell,
        len(runs),
        sum(run["end"] == "finished" for run in right),
        len(right),
        _total(runs, "wrong_placements"),
        f"{_total(runs, 'robot_placements') / len(runs):.1f}",
        _total(runs, "help_requests"),
        f"{len(touched)}, {fast}",
        f"{told_right} of {_total(runs, 'placed')}; {_total(runs, 'told') - told_right}",
        f"{_total(runs, 'sim_time_s') / len(runs):.0f} s",
    )
    return f"| {' | '.join(map(str, cells))} |"


def _total(runs: Sequence[Run], name: str) -> float:
    total = sum(float(run.get(name) or 0) for run in runs)
    return int(total) if total == int(total) else total


if __name__ == "__main__":
    main()
