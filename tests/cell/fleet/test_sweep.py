"""A small sweep on Dask: all runs are there though a worker is killed, as they are one by one, and none twice."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import psutil
import pytest

from cell.fleet.one_run import run_here
from cell.fleet.spec import Seeds, Sweep, count, load_sweep, tasks
from cell.fleet.table import read_table

WALL = ("peak", "wall", "took", "cpu", "real_time", "overruns", "late", "log", "contact_sheet")
SPEC = "seeds: {first: 3, count: 3}\nmax_duration_s: 0.3\ngoals: [g0, g1]\n"


def decided(row: dict[str, Any]) -> dict[str, Any]:
    """What of a row does not hang on the machine, as the table holds it."""
    return {
        name: json.dumps(value) if isinstance(value, dict | list) else value
        for name, value in row.items()
        if not name.startswith(WALL) and value is not None
    }


def workers(of: int) -> list[psutil.Process]:
    """Processes of a sweep that run tasks, found by what they were started as."""
    return [one for one in psutil.Process(of).children(recursive=True) if "spawn_main" in " ".join(one.cmdline())]


@pytest.mark.slow
def test_a_sweep_whose_worker_is_killed_has_all_runs(tmp_path: Path) -> None:
    spec, out = tmp_path / "spec.yaml", tmp_path / "out"
    spec.write_text(SPEC)
    command = [sys.executable, "-m", "cell", "lab", "sweep", str(spec), "--out", str(out), "--workers", "1", "--json"]
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    told = {"stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL, "env": {**os.environ, "TMPDIR": str(scratch)}}
    with subprocess.Popen(command, text=True, **told) as running:  # type: ignore[call-overload]
        journal = out / "runs.jsonl"
        while running.poll() is None and not (journal.exists() and journal.read_bytes().count(b"\n")):
            time.sleep(0.05)
        for victim in workers(running.pid):
            try:
                os.kill(victim.pid, signal.SIGKILL)
            except ProcessLookupError:
                continue
        answer, _ = running.communicate()
    assert running.returncode == 0, answer
    left = [path for path in scratch.iterdir() if path.name != ".ses"]  # onnxruntime leaves that in TMPDIR by itself
    assert not left, "something of the killed workers is left"
    rows = read_table(out / "runs.parquet")
    alone = [run_here(task) for task in tasks(load_sweep(spec))]
    assert [row["key"] for row in rows] == [row["key"] for row in alone]
    assert [decided(row) for row in rows] == [decided(row) for row in alone]
    before = (out / "runs.jsonl").read_bytes()
    done = subprocess.run(command, capture_output=True, check=False)  # goes on where it stopped: nothing is left
    assert (done.returncode, (out / "runs.jsonl").read_bytes()) == (0, before)


def test_every_combination_is_a_task_of_its_own() -> None:
    sweep = Sweep(seeds=Seeds(count=2), people=("careful", "careless"), goals=("g0", "random"), faults=(None,))
    found = list(tasks(sweep))
    assert len({task.key for task in found}) == len(found) == count(sweep) == 8
    assert [task.seed for task in found] == [0] * 4 + [1] * 4
    names = {name for name, _ in found[0].files}
    assert {
        "trees/assemble.xml",
        "trees/clear_and_grasp.xml",
        "config/cell.yaml",
        "config/products.yaml",
        "config/sim.yaml",
    } <= names
