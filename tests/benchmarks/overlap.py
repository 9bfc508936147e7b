"""Whole `cell run`s in pairs, one after the other: how much faster the overlap of physics and frames is, and its cost.

python -m tests.benchmarks.overlap --pairs 3 [--before CHECKOUT]
"""

from __future__ import annotations

import argparse
import ctypes
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from rich.console import Console
from rich.table import Table

from tests import ROOT

PR_SET_CHILD_SUBREAPER = 36  # orphans become ours, and their processor time is counted once they end


@dataclass(frozen=True)
class Cost:
    """What one run took."""

    wall_s: float
    processor_s: float


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, default=3)
    parser.add_argument("--first-seed", type=int, default=3)
    parser.add_argument("--before", type=Path, help="checkout to compare with; by default this one without overlap")
    parser.add_argument("--max-duration-s", type=float, default=300.0, help="end runs after so much simulated time")
    options = parser.parse_args()
    adopt_orphans()
    console = Console(stderr=True)
    pairs: list[tuple[Cost, Cost]] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        after = configuration(ROOT, folder / "after.yaml", True, options.max_duration_s)
        checkout, overlap = (options.before.resolve(), None) if options.before else (ROOT, False)
        before = configuration(checkout, folder / "before.yaml", overlap, options.max_duration_s)
        for seed in range(options.first_seed, options.first_seed + options.pairs):
            first, second = run(checkout, before, seed, folder), run(ROOT, after, seed, folder)
            pairs.append((first, second))
            console.print(
                f"seed {seed}: {first.wall_s / second.wall_s:.2f} x as fast, "
                f"{second.processor_s / first.processor_s:.2f} x the processor time",
                highlight=False,
            )
    Console().print(table(pairs))


def adopt_orphans() -> None:
    """From now on the processor time of every process that a run leaves behind is counted, too."""
    ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)


def configuration(checkout: Path, path: Path, overlap: bool | None, max_duration_s: float) -> Path:
    """The checkout's configuration with or without overlap; None leaves it out, for code that does not know it."""
    text = (checkout / "config" / "cell.yaml").read_text()
    text = text.replace("product: products.yaml", f"product: {checkout / 'config' / 'products.yaml'}")
    text = text.replace("max_duration_s: 300.0", f"max_duration_s: {max_duration_s}")
    if overlap is not None:
        said = f"  simulation:\n    overlap: {str(overlap).lower()}\n"
        has_key = "  simulation:\n" in text
        text = text.replace("  simulation:\n", said) if has_key else text.replace("devices:\n", f"devices:\n{said}")
    path.write_text(text)
    return path


def run(checkout: Path, configured: Path, seed: int, folder: Path) -> Cost:
    """One `cell run` with its log; every process of it is waited for."""
    command = [sys.executable, "-m", "cell", "run", "--config", str(configured), "--seed", str(seed), "--json"]
    environment = {**os.environ, "PYTHONPATH": str(checkout)}
    log = folder / f"{time.monotonic_ns()}.mcap"
    began_s, spent_s = time.monotonic(), processor_s()
    process = subprocess.Popen(
        [*command, "--log", str(log)],
        cwd=checkout,
        env=environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    process.wait()
    wall_s = time.monotonic() - began_s
    while True:
        try:
            os.wait()
        except ChildProcessError:
            return Cost(wall_s, processor_s() - spent_s)


def processor_s() -> float:
    """Processor time of all children that have ended."""
    times = os.times()
    return times.children_user + times.children_system


def table(pairs: list[tuple[Cost, Cost]]) -> Table:
    """Medians, and the ratios of the pairs."""
    before, after = zip(*pairs, strict=True)
    shown = Table("median", "before", "after", "of a pair: least, median, most", title=f"{len(pairs)} paired runs")
    for name, ratios in (
        ("wall_s", sorted(one.wall_s / two.wall_s for one, two in pairs)),
        ("processor_s", sorted(two.processor_s / one.processor_s for one, two in pairs)),
    ):
        values = [f"{median(getattr(cost, name) for cost in costs):.2f}" for costs in (before, after)]
        what = "x as fast" if name == "wall_s" else "x as much"
        shown.add_row(name, *values, f"{ratios[0]:.2f}, {median(ratios):.2f}, {ratios[-1]:.2f} {what}")
    return shown


if __name__ == "__main__":
    main()
