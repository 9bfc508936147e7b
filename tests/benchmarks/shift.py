"""A shift with a table of its brackets: time, who placed what, what was asked, memory of the process.

python -m tests.benchmarks.shift --brackets 60 --person careful,ordinary,careless --seed 62000
python -m tests.benchmarks.shift --bare --hours 8 --seed 64000                     # eight hours of the cell's time
python -m tests.benchmarks.shift --bare --brackets 6 --tree trees/shift_ahead.xml  # another tree
With --bare nothing is rendered: hands, holes and parts come from the truth. Without --log the log is thrown away at
the end. Ctrl-C ends the shift as always, and the table tells what was done so far.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import Any

from rich.console import Console

from bracket_cell.runs.options import RunOptions
from bracket_cell.runs.run import run
from tests import ROOT

COLUMNS = ("number", "goal", "correct", "finished", "begin_s", "sim_time_s", "robot_placements", "help_requests")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--brackets", type=int, default=0, help="0: until the time is over")
    parser.add_argument("--hours", type=float, default=8.0, help="of the cell's time, at most")
    parser.add_argument("--person", default="careful,ordinary,careless")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--tree", type=Path, default=ROOT / "trees" / "shift.xml")
    parser.add_argument("--bare", action="store_true", help="render nothing")
    parser.add_argument("--log", type=Path)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        options = RunOptions(
            tree=asked.tree,
            seed=asked.seed,
            person=asked.person,
            brackets=asked.brackets,
            log=asked.log or Path(folder) / "shift.mcap",
            max_duration_s=asked.hours * 3600,
            pixels=not asked.bare,
            images=not asked.bare,
        )
        summary = run(options, Console(quiet=True)).summary
        size_mb = sum(file.stat().st_size for file in Path(options.log or "").parent.glob("shift*.mcap")) / 1e6
    table(summary)
    print(f"log {size_mb:.0f} MB in {summary['log_parts']} parts" if asked.log is None else f"log {asked.log}")


def table(summary: dict[str, Any]) -> None:
    """A line a bracket, then the sums."""
    rows = summary.get("brackets", [])
    print(" ".join(f"{name:>16}" for name in (*COLUMNS, "known_wrong", "rss_mb")))
    for row in rows:
        wrong = "/".join(row["known_wrong"]) or "-"
        print(" ".join(f"{row[name]!s:>16}" for name in COLUMNS), f"{wrong:>16} {row['rss_mb']!s:>16}", sep=" ")
    done = [row for row in rows if row["finished"]]
    mean_s = sum(row["sim_time_s"] for row in done) / max(len(done), 1)
    sums = ("right", "wrong", "unfinished", "asked", "end", "reason", "sim_time_s", "wall_time_s", "peak_rss_mb")
    print("; ".join(f"{name} {summary.get(name)}" for name in sums))
    by_robot = sum(row["robot_placements"] or 0 for row in done)
    print(f"a finished bracket takes {mean_s:.1f} s on average; the robot placed {by_robot} parts")


if __name__ == "__main__":
    main()
