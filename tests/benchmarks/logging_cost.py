"""What the log costs: the same assembly with it and without, in turns; wall time of a tick, and processor time of all.

python -m tests.benchmarks.logging_cost --seed 3 --goal g2 --times 3

A tick is observe, tick, act and record. The log's own threads work beside it (JPEG files, the disk): their processor
time is in the last row, which counts every thread of the process, physics and rendering included.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

import bracket_cell.runs.assembled
from bracket_cell.recording import joint_samples
from bracket_cell.recording.recorder import McapRecorder
from bracket_cell.running.controller import Controller
from bracket_cell.runs.options import RunOptions
from bracket_cell.runs.run import run
from bracket_cell.skills.drivers.can_gripper import CanFrame
from bracket_cell.watching.observer import Level, TickRecord
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.observation import JointSamples
from bracket_sim.devices.arm import SimArm

Cost = dict[str, float]
KEYS = (
    "tick, wall",
    "tick, its thread",
    "whole run a tick, all threads",
    "joint samples",
    "samples a second",
    "log MB",
)


class NoLog(McapRecorder):
    """Opens a file and writes nothing into it."""

    def frame(self, frame: Frame) -> None:
        pass

    def tick(self, record: TickRecord) -> None:
        pass

    def can_frame(self, frame: CanFrame) -> None:
        pass

    def message(self, time_s: float, level: Level, text: str) -> None:
        pass

    def settle(self) -> None:
        pass


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("--goal", default="g2")
    parser.add_argument("--times", type=int, default=3, help="runs with the log, and as many without")
    options = parser.parse_args()
    costs: dict[bool, list[Cost]] = {True: [], False: []}
    measured("warm-up", NoLog, options.goal, options.seed)
    for number in range(options.times):
        for logged in (True, False) if number % 2 else (False, True):
            name = f"{'with' if logged else 'without'} the log"
            costs[logged].append(measured(name, McapRecorder if logged else NoLog, options.goal, options.seed))
    report(costs)


def report(costs: dict[bool, list[Cost]]) -> None:
    """Medians of all runs, with and without."""
    off, on = (
        {name: statistics.median(cost[name] for cost in costs[logged]) for name in KEYS} for logged in (False, True)
    )
    table = Table("", "without ms", "with ms", "ratio")
    rows = {name: (off[name], on[name]) for name in KEYS[:3]}
    bare, extra = off["tick, its thread"], on["whole run a tick, all threads"] - off["whole run a tick, all threads"]
    rows["tick and the log's threads"] = bare, bare + extra
    for name, (without, having) in rows.items():
        table.add_row(name, f"{1e3 * without:.3f}", f"{1e3 * having:.3f}", f"{having / without:.3f}")
    console = Console(soft_wrap=True, highlight=False)
    console.print(table)
    share = f"{on['samples a second']:.0f} a second of the run, {100 * on['joint samples']:.3f} % of a core"
    console.print(f"joint samples: {share}; log {on['log MB']:.2f} MB")


def measured(name: str, recorder: type[McapRecorder], goal: str, seed: int) -> Cost:
    """Seconds a tick of one run by what they were spent on."""
    spent: dict[str, float] = defaultdict(float)
    originals = [
        watched(Controller, "_tick", spent, "tick"),
        watched(Controller, "run", spent, "run"),
        watched(McapRecorder, "settle", spent, "settle"),
        watched(SimArm, "samples", spent, "samples"),
        watched(joint_samples, "encode", spent, "encode"),
    ]
    took = SimArm.samples

    def counted(self: SimArm) -> JointSamples:
        found = took(self)
        spent["count"] += len(found.times_s)
        return found

    SimArm.samples = counted  # type: ignore[method-assign]
    setattr(bracket_cell.runs.assembled, "McapRecorder", recorder)  # noqa: B010 - the name that `run` looks up
    try:
        with tempfile.TemporaryDirectory() as folder:
            log = Path(folder) / "log.mcap"
            outcome = run(RunOptions(goal=goal, seed=seed, log=log), Console(quiet=True)).outcome
            size_mb = log.stat().st_size / 1e6
    finally:
        setattr(bracket_cell.runs.assembled, "McapRecorder", McapRecorder)  # noqa: B010
        for owner, method, original in originals:
            setattr(owner, method, original)
    values = (
        (spent["tick wall"] + spent["settle wall"]) / outcome.ticks,
        (spent["tick thread"] + spent["settle thread"]) / outcome.ticks,
        spent["run process"] / outcome.ticks,
        (spent["samples thread"] + spent["encode thread"]) / outcome.sim_time_s,
        spent["count"] / outcome.sim_time_s,
        size_mb,
    )
    cost = dict(zip(KEYS, values, strict=True))
    told = ", ".join(f"{key} {1e3 * value:.3f} ms" for key, value in list(cost.items())[:3])
    Console(stderr=True, soft_wrap=True).print(f"{name}: {told}", highlight=False)
    return cost


def watched(owner: Any, method: str, spent: dict[str, float], name: str) -> tuple[Any, str, Callable[..., Any]]:
    """Put stop watches on a method: wall time, its thread's and all threads' processor time; returns what was there."""
    original = getattr(owner, method)
    clocks = {"wall": time.perf_counter, "thread": time.thread_time, "process": time.process_time}

    def timed(*arguments: Any, **named: Any) -> Any:
        began = {kind: clock() for kind, clock in clocks.items()}
        try:
            return original(*arguments, **named)
        finally:
            for kind, clock in clocks.items():
                spent[f"{name} {kind}"] += clock() - began[kind]

    setattr(owner, method, timed)
    return owner, method, original


if __name__ == "__main__":
    main()
