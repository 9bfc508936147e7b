"""What the log costs, within one run: time spent in the recorder against the ticks' own time.

python -m tests.benchmarks.logging_cost --seed 3 --goal g2
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rich.console import Console

from cell.recorder import McapRecorder
from cell.run import RunOptions, run

METHODS = ("frame", "tick", "can_frame", "message")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("--goal", default="g2")
    options = parser.parse_args()
    spent_s: dict[str, float] = dict.fromkeys(METHODS, 0.0)
    calls: Counter[str] = Counter()
    walls_s: list[float] = []
    for name in METHODS:
        setattr(McapRecorder, name, timed(getattr(McapRecorder, name), name, spent_s, calls, walls_s))
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "log.mcap"
        result = run(RunOptions(goal=options.goal, seed=options.seed, log=log), Console(quiet=True))
        size = log.stat().st_size
    console = Console(soft_wrap=True, highlight=False)
    ticks = result.outcome.ticks
    # Frames and CAN frames are recorded within the tick's own time, the tick after it.
    bare_s = sum(walls_s) - spent_s["frame"] - spent_s["can_frame"]
    logging_s = sum(spent_s.values())
    for name in METHODS:
        each_us = 1e6 * spent_s[name] / max(1, calls[name])
        console.print(f"{name}: {calls[name]} calls, {each_us:.0f} us each")
    console.print(
        f"tick without log {1e3 * bare_s / ticks:.3f} ms, with log {1e3 * (bare_s + logging_s) / ticks:.3f} ms"
    )
    console.print(f"ratio {1 + logging_s / bare_s:.3f}; log {size / 1e6:.2f} MB, {result.outcome.end}")


def timed(
    method: Callable[..., None], name: str, spent_s: dict[str, float], calls: Counter[str], walls_s: list[float]
) -> Callable[..., None]:
    """The method with a stop watch."""

    def measured(self: McapRecorder, *arguments: Any, **named: Any) -> None:
        began_s = time.perf_counter()
        method(self, *arguments, **named)
        spent_s[name] += time.perf_counter() - began_s
        calls[name] += 1
        if name == "tick":
            walls_s.append(arguments[0].wall_s)

    return measured


if __name__ == "__main__":
    main()
