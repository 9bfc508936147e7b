"""Whole assemblies by `cell run`: how many end correct, by goal and by how they failed.

python -m tests.benchmarks.assembly --runs 30 --out runs/assembly.jsonl
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from bracket_cell.configuration import load_configuration, load_product

LONGEST_S = 1800.0  # of wall time: machines are shared
Run = Mapping[str, Any]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=30, help="shared out among the goals")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--person", default="careful", help="who stands at the bench")
    parser.add_argument("--out", type=Path, help="one line of JSON for each run")
    options = parser.parse_args()
    goals = sorted(load_product(load_configuration()).goals)
    console = Console(stderr=True)
    runs: list[Run] = []
    for seed in range(options.first_seed, options.first_seed + options.runs):
        runs.append(assemble(goals[seed % len(goals)], seed, options.person))
        console.print(f"seed {seed}: {verdict(runs[-1])}", highlight=False)
        if options.out is not None:
            with options.out.open("a") as stream:
                stream.write(json.dumps(runs[-1]) + "\n")
    Console().print(table(runs, goals))


def assemble(
    goal: str,
    seed: int,
    person: str = "careful",
    more: Sequence[str] = (),
    read: Callable[[Path], Run] = lambda _: {},
) -> Run:
    """The JSON line of one `cell run`; a run that prints none is one that failed to end by itself.

    Args:
        more: arguments of `cell run`.
        read: looks at the log for more keys.
    """
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "log.mcap"
        command = [
            sys.executable,
            "-m",
            "bracket_cell",
            "lab",
            "run",
            "--goal",
            goal,
            "--seed",
            str(seed),
            "--log",
            str(log),
        ]
        command += ["--json"]
        command += ["--person", person, *more]
        try:
            result = subprocess.run(command, capture_output=True, text=True, timeout=LONGEST_S, check=False)
        except subprocess.TimeoutExpired:
            return {"goal": goal, "seed": seed, "correct": False, "end": "hung", "reason": f"no end in {LONGEST_S} s"}
        lines = result.stdout.splitlines()
        if not lines:
            return {"goal": goal, "seed": seed, "correct": False, "end": "refused", "reason": result.stderr.strip()}
        run: Run = {**json.loads(lines[-1]), "exit_status": result.returncode, **read(log)}
        return run


def verdict(run: Run) -> str:
    """How a run went, in a few words: one kind of failure has one wording."""
    if run["correct"]:
        return "correct" if run["end"] == "finished" else f"correct, but {run['end']}"
    if run["end"] == "finished":
        return "finished wrong"
    return re.sub(r"\d+(\.\d+)?", "#", f"{run['end']}: {run['reason']}")


def table(runs: Iterable[Run], goals: list[str]) -> Table:
    """Runs by verdict and goal, and the means of what they took."""
    runs = list(runs)
    shown = Table("outcome", *goals, "all", title=f"{len(runs)} assemblies")
    for kind in sorted({verdict(run) for run in runs}):
        counts = [sum(verdict(run) == kind and run["goal"] == goal for run in runs) for goal in goals]
        shown.add_row(kind, *map(str, counts), str(sum(counts)))
    for name in (
        "robot_placements",
        "contacts",
        "contact_speed_m_s",
        "contact_force_n",
        "help_requests",
        "overruns",
        "sim_time_s",
        "wall_time_s",
        "real_time_factor",
    ):
        means = [_mean(run.get(name) for run in runs if run["goal"] == goal) for goal in goals]
        shown.add_row(f"mean {name}", *means, _mean(run.get(name) for run in runs))
    return shown


def _mean(values: Iterable[Any]) -> str:
    known = [float(value) for value in values if value is not None]
    return f"{sum(known) / len(known):.2f}" if known else "-"


if __name__ == "__main__":
    main()
