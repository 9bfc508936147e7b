"""Many short runs by `cell lab sweep` on two workers, some of them killed on the way, against the same runs one by one.

python -m tests.benchmarks.many_runs --runs 1000 --kill 2 --out /tmp/many

A run activates the gripper, without pixels: about half a second of processor time. What was done stays in the folder;
called again, it goes on there. Overhead: what the workers needed over the runs themselves, from the first row to the
last, lost runs and new workers included. --chart draws how cost and memory of a run and the journal's size grow.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import psutil

from bracket_cell.fleet.one_run import run_here
from bracket_cell.fleet.spec import count, load_sweep, tasks
from bracket_cell.fleet.table import read_table
from tests.cell.fleet.test_sweep import decided, workers

TREE = """<root BTCPP_format="4" main_tree_to_execute="Short">
  <BehaviorTree ID="Short"><Sequence><ActivateGripper/></Sequence></BehaviorTree>
</root>
"""
SPEC = "seeds: {{first: 0, count: {runs}}}\ntrees: [short.xml]\npeople: [careful]\npixels: false\n"
LOOK_S = 0.5
DRAWN = 100  # runs in each point of the chart


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--kill", type=int, default=2, help="workers that are killed, spread over the sweep")
    parser.add_argument("--check", type=int, default=100, help="runs that are done again one by one")
    parser.add_argument("--out", type=Path, help="folder; a temporary one by default")
    parser.add_argument("--chart", type=Path, help="SVG file")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="many-runs-") as folder:
        out: Path = options.out or Path(folder)
        out.mkdir(parents=True, exist_ok=True)
        (out / "short.xml").write_text(TREE)
        spec = out / "spec.yaml"
        spec.write_text(SPEC.format(runs=options.runs))
        sweep(spec, out, options.workers, [options.runs * (n + 1) // (options.kill + 1) for n in range(options.kill)])
        compare(spec, out, options.check)
        if options.chart:
            draw(rows(out), (out / "runs.jsonl").stat().st_size, options.chart)


def sweep(spec: Path, out: Path, of: int, kill_at: list[int]) -> None:
    """Run it, kill workers at these numbers of rows, and say what it cost beyond the runs.

    Args:
        of: how many workers there are.
    """
    command = [sys.executable, "-m", "bracket_cell", "lab", "sweep", str(spec), "--out", str(out), "--workers", str(of)]
    journal = Journal(out)
    before, began_s, killed = journal.count(), time.perf_counter(), 0
    seen: list[tuple[float, int]] = []  # when there were how many rows
    kill_at = [at for at in kill_at if at > before]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as running:
        while running.poll() is None:
            done = journal.count()
            if done > (seen[-1][1] if seen else before):
                seen.append((time.perf_counter(), done))
            if kill_at and done >= kill_at[0]:
                kill_at.pop(0)
                killed += kill_one(running.pid)
            time.sleep(LOOK_S)
    print(f"exit {running.returncode}; {len(rows(out)) - before} runs in this call, {killed} workers killed")
    if len(seen) > 1:
        (first_s, first), (last_s, last) = seen[0], seen[-1]
        busy_s, spent_s = sum(row["took_s"] for row in rows(out)[first:last]), of * (last_s - first_s)
        print(
            f"first row after {first_s - began_s:.1f} s, {last - first} more in {last_s - first_s:.1f} s, {of} workers"
        )
        print(f"runs took {busy_s:.1f} of {spent_s:.1f} worker seconds: overhead {spent_s / busy_s - 1:.1%}")


def compare(spec: Path, out: Path, checked: int) -> None:
    """Whether all are there, and whether some of them, done again one by one, are the same."""
    asked = load_sweep(spec)
    wanted = {task.key: task for task in tasks(asked)}
    found = {row["key"]: row for row in read_table(out / "runs.parquet")} if (out / "runs.parquet").exists() else {}
    print(f"{len(found.keys() & wanted.keys())} of {count(asked)} runs in the table, none twice: {len(rows(out))} rows")
    ends = [row["end"] for row in found.values()]
    print("ended: " + ", ".join(f"{ends.count(end)} {end}" for end in sorted(set(ends))))
    sample = random.Random(0).sample(sorted(found), min(checked, len(found)))
    same = sum(decided(found[key]) == decided(run_here(wanted[key])) for key in sample)
    print(f"the same as one by one: {same} of {len(sample)}")


def kill_one(sweep_process: int) -> int:
    """Kill a worker and the process of its run."""
    direct = psutil.Process(sweep_process).children()
    for worker in [one for one in workers(sweep_process) if one in direct][:1]:
        for one in (*worker.children(recursive=True), worker):
            try:
                os.kill(one.pid, signal.SIGKILL)
            except ProcessLookupError:
                continue
        return 1
    return 0


def draw(found: list[dict[str, Any]], size: int, file: Path) -> None:
    """Medians of processor time and memory of so many runs each, by how many runs were done before them."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(7, 2.6))
    ends = range(DRAWN, len(found) + 1, DRAWN)
    for axis, (column, what) in zip(axes, (("cpu_s", "processor [s]"), ("peak_rss_mb", "memory [MB]")), strict=True):
        axis.plot(ends, [statistics.median(row[column] for row in found[end - DRAWN : end]) for end in ends])
        axis.set_xlabel("runs done")
        axis.set_ylabel(f"{what} of a run")
        axis.set_ylim(bottom=0)
    figure.suptitle(f"{len(found)} runs, {size / len(found) / 1e3:.1f} kB of rows each", fontsize=9)
    figure.tight_layout()
    figure.savefig(file, metadata={"Date": None})
    plt.close(figure)


class Journal:
    """Counts rows without reading any twice: a look at ten thousand would cost as much as a run."""

    def __init__(self, out: Path) -> None:
        self._path, self._read, self._rows = out / "runs.jsonl", 0, 0

    def count(self) -> int:
        """Whole lines so far."""
        if self._path.exists():
            with self._path.open("rb") as journal:
                journal.seek(self._read)
                new = journal.read()
            self._read += len(new)
            self._rows += new.count(b"\n")
        return self._rows


def rows(out: Path) -> list[dict[str, Any]]:
    """Whole lines of the journal."""
    journal = out / "runs.jsonl"
    lines = journal.read_bytes().splitlines(keepends=True) if journal.exists() else []
    return [json.loads(line) for line in lines if line.endswith(b"\n")]


if __name__ == "__main__":
    main()
