"""Records assemblies, some disturbed, and replays every log: identical or not, and how fast.

python -m tests.benchmarks.replays --runs 30
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.log.read.reader import read_log

LONGEST_S = 600.0
FAULT_AFTER_S = 20.0
ROUND = 6
# What happens in which run of a round; the others go undisturbed.
DISTURBANCES = {2: "gripper silent", 4: "SIGTERM", 5: "SIGKILL"}
# The gripper node falls silent in mid-run; everything else is `cell run`.
SILENT = f"""
import sys
from bracket_sim.devices.simulated_gripper import GripperNode
update = GripperNode.update
def update_or_fall_silent(self, time_s, dt_s):
    if time_s > {FAULT_AFTER_S}:
        self.silence()
    update(self, time_s, dt_s)
GripperNode.update = update_or_fall_silent
from bracket_cell.commands.main import main
sys.exit(main(sys.argv[1:]))
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=30, help="shared out among the goals and disturbances")
    parser.add_argument("--first-seed", type=int, default=0)
    options = parser.parse_args()
    goals = sorted(load_product(load_configuration()).goals)
    table = Table(
        "seed",
        "goal",
        "disturbance",
        "end",
        "ticks",
        "run s",
        "replay",
        "replay s",
        "CPU s",
        "x real time",
        "x in CPU",
        "MB",
    )
    identical = 0
    whole: list[Mapping[str, Any]] = []
    disturbed: list[Mapping[str, Any]] = []
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(options.first_seed, options.first_seed + options.runs):
            log = Path(folder) / f"{seed}.mcap"
            round_, place = divmod(seed, ROUND)  # every goal meets every disturbance
            goal, disturbance = goals[(round_ + place) % len(goals)], DISTURBANCES.get(place, "none")
            record(log, goal, seed, disturbance)
            row = replayed(log)
            identical += row["replay"] == "identical"
            (whole if disturbance == "none" else disturbed).append(row)
            table.add_row(str(seed), goal, disturbance, *(str(value) for value in row.values()))
            Console(stderr=True).print(seed, goal, disturbance, row)
            log.unlink()
    Console(width=140).print(table)
    Console().print(f"{identical} of {options.runs} replays are identical")
    for what, rows in (("whole", whole), ("disturbed", disturbed)):
        for unit in ("speed", "cpu_speed") if rows else ():
            speeds = [float(row[unit]) for row in rows]
            clock = "wall" if unit == "speed" else "processor"
            mean, least = statistics.mean(speeds), min(speeds)
            Console().print(f"{len(rows)} {what} runs, {clock} time: {mean:.0f} x real time, least {least:.0f} x")


def record(log: Path, goal: str, seed: int, disturbance: str) -> None:
    """Run the cell; a signal comes once the log has reached FAULT_AFTER_S."""
    program = ["-c", SILENT] if disturbance == "gripper silent" else ["-m", "bracket_cell"]
    command = [sys.executable, *program, "run", "--goal", goal, "--seed", str(seed), "--log", str(log)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        for line in process.stderr:
            told_s = line.split()[0] if line.strip() else ""
            if disturbance.startswith("SIG") and _number(told_s) > FAULT_AFTER_S:
                os.kill(process.pid, signal.Signals[disturbance])
                disturbance = "done"
        process.wait(LONGEST_S)


def replayed(log: Path) -> Mapping[str, Any]:
    """A row of the table: `cell replay` in a process of its own, its start included."""
    began_s, began_cpu_s = time.monotonic(), children_s()
    command = [sys.executable, "-m", "bracket_cell", "replay", str(log), "--json"]
    result = subprocess.run(command, capture_output=True, text=True, timeout=LONGEST_S, check=False)
    wall_s, cpu_s = time.monotonic() - began_s, children_s() - began_cpu_s
    read = read_log(log)
    run_s = read.ticks[-1].time_s
    answer = json.loads(result.stdout) if result.stdout else {}
    verdict = "identical" if answer.get("identical") else str(answer.get("first") or result.stderr.strip())[:200]
    if answer.get("identical") and answer["ticks"] != len(read.ticks):
        verdict = f"only {answer['ticks']} of {len(read.ticks)} ticks"
    return {
        "end": read.outcome.get("end", "cut off"),
        "ticks": len(read.ticks),
        "run": round(run_s, 1),
        "replay": verdict,
        "replay_s": round(wall_s, 2),
        "cpu_s": round(cpu_s, 2),
        "speed": round(run_s / wall_s, 1),
        "cpu_speed": round(run_s / cpu_s, 1),
        "mb": round(log.stat().st_size / 1e6, 1),
    }


def children_s() -> float:
    """Processor time of all processes that were started and have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return 0.0


if __name__ == "__main__":
    main()
