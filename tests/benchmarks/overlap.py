"""Whole `cell run`s in pairs, one after the other: how much faster the overlap of physics and frames is, and its cost.

python -m tests.benchmarks.overlap --pairs 3 [--before CHECKOUT] [--classical]

Byte code is compiled before. Processor time is that of all processes of a run. Beside the ratios of whole assemblies
stand those of a simulated second, as two releases take different times for the same bracket.
"""

from __future__ import annotations

import argparse
import ctypes
import json
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

FIRST_TICKS_S = 0.03
PR_SET_CHILD_SUBREAPER = 36  # orphans become ours, and their processor time is counted once they end


@dataclass(frozen=True)
class Cost:
    """What one run took.

    Attributes:
        cell_s: how long it lasted in the cell.
        others_s: processor time of everything else on the machine meanwhile; a pair says little where it is large.
    """

    wall_s: float
    processor_s: float
    cell_s: float = 1.0
    others_s: float = 0.0

    @property
    def wall_each_s(self) -> float:
        """For a second in the cell."""
        return self.wall_s / self.cell_s

    @property
    def processor_each_s(self) -> float:
        """For a second in the cell."""
        return self.processor_s / self.cell_s


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, default=3)
    parser.add_argument("--first-seed", type=int, default=3)
    parser.add_argument("--before", type=Path, help="checkout to compare with; by default this one without overlap")
    parser.add_argument("--max-duration-s", type=float, default=300.0, help="end runs after so much simulated time")
    parser.add_argument("--classical", action="store_true", help="classical perception in both, as it was before")
    options = parser.parse_args()
    adopt_orphans()
    console = Console(stderr=True)
    pairs: list[tuple[Cost, Cost]] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        use_byte_code(folder)
        checkout, overlap = (options.before.resolve(), None) if options.before else (ROOT, False)
        for duration_s in (FIRST_TICKS_S, options.max_duration_s):
            after = configuration(ROOT, folder / "after.yaml", True, duration_s)
            before = configuration(checkout, folder / "before.yaml", overlap, duration_s)
            if options.classical:
                for path in (before, after):
                    path.write_text(path.read_text().replace("kind: learned", "kind: classical"))
            if duration_s == FIRST_TICKS_S:  # they compile
                run(checkout, before, 0, folder), run(ROOT, after, 0, folder)
        for seed in range(options.first_seed, options.first_seed + options.pairs):
            first, second = run(checkout, before, seed, folder), run(ROOT, after, seed, folder)
            pairs.append((first, second))
            console.print(
                f"seed {seed}: {first.wall_s / second.wall_s:.2f} x as fast, "
                f"{second.processor_s / first.processor_s:.2f} x the processor time; "
                f"before {first.wall_s:.1f} s, {first.processor_s:.1f} s, {first.cell_s:.1f} s in the cell; "
                f"after {second.wall_s:.1f} s, {second.processor_s:.1f} s, {second.cell_s:.1f} s; "
                f"others took {first.others_s:.1f} and {second.others_s:.1f} s",
                highlight=False,
            )
    Console().print(table(pairs))


def use_byte_code(folder: Path) -> None:
    """From now on, what was compiled once is not compiled again, as where the cell is installed."""
    os.environ["PYTHONPYCACHEPREFIX"] = str(folder / "byte-code")
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)


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
    command = [sys.executable, "-m", "bracket_cell", "run", "--config", str(configured), "--seed", str(seed), "--json"]
    environment = {**os.environ, "PYTHONPATH": str(checkout)}
    log = folder / f"{time.monotonic_ns()}.mcap"
    began_s, spent_s, busy_s = time.monotonic(), processor_s(), machine_s()
    said = folder / "said.json"
    with said.open("w") as out:
        process = subprocess.Popen(
            [*command, "--log", str(log)], cwd=checkout, env=environment, stdout=out, stderr=subprocess.DEVNULL
        )
        process.wait()
    wall_s = time.monotonic() - began_s
    while True:
        try:
            os.wait()
        except ChildProcessError:
            spent_s = processor_s() - spent_s
            others_s = max(0.0, machine_s() - busy_s - spent_s)
            return Cost(wall_s, spent_s, float(json.loads(said.read_text())["sim_time_s"]), others_s)


def processor_s() -> float:
    """Processor time of all children that have ended."""
    times = os.times()
    return times.children_user + times.children_system


def machine_s() -> float:
    """Processor time of everything on this machine since it started."""
    user, nice, system = map(int, Path("/proc/stat").read_text().split(maxsplit=4)[1:4])
    return (user + nice + system) / os.sysconf("SC_CLK_TCK")


def table(pairs: list[tuple[Cost, Cost]]) -> Table:
    """Medians, and the ratios of the pairs."""
    before, after = zip(*pairs, strict=True)
    shown = Table("median", "before", "after", "of a pair: least, median, most", title=f"{len(pairs)} paired runs")
    for name in ("wall_s", "wall_each_s", "processor_s", "processor_each_s"):
        told = [[float(getattr(cost, name)) for cost in costs] for costs in (before, after)]
        faster = name.startswith("wall")
        ratios = sorted(one / two if faster else two / one for one, two in zip(*told, strict=True))
        what = "x as fast" if faster else "x as much"
        spread = f"{ratios[0]:.2f}, {median(ratios):.2f}, {ratios[-1]:.2f} {what}"
        shown.add_row(name, *(f"{median(values):.3g}" for values in told), spread)
    return shown


if __name__ == "__main__":
    main()
