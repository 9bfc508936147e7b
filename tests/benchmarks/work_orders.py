"""With work orders the robot's first act comes earlier: the same brackets with and without them.

python -m tests.benchmarks.work_orders --pairs 60 --tree trees/shift_ahead.xml
Nothing is rendered. Told is when the robot was first allowed to place a part, and when it had placed its first one,
after each bracket began; a bracket in which it placed none counts as long as it took.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from rich.console import Console

from bracket_cell.recording.parts import parts_of
from bracket_cell.runs.options import RunOptions
from bracket_cell.runs.run import run
from tests import ROOT

GOALS = ("g0", "g1", "g2")
FIRST_SEED = 910_000
READ = ("/note/bracket", "/note/verdict", "/note/belief")


def firsts(seed: int, tree: Path, with_orders: bool) -> tuple[list[tuple[float, float]], int]:
    """For each of three brackets (s to the first act allowed, s to the first part placed), and how many are right."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path = folder / "orders.jsonl"
        path.write_text("".join(json.dumps({"variant": goal}) + "\n" for goal in GOALS), encoding="utf-8")
        options = RunOptions(
            tree=tree,
            goal=",".join(GOALS),
            seed=seed,
            log=folder / "log.mcap",
            brackets=len(GOALS),
            max_duration_s=900.0,
            pixels=False,
            images=False,
            one_process=True,
            work_orders=path if with_orders else None,
        )
        summary = run(options, Console(quiet=True)).summary
        return list(_read(parts_of(folder / "log.mcap"))), int(str(summary.get("right", 0)))


def _read(parts: list[Path]) -> Iterator[tuple[float, float]]:
    begun_s = act_s = placed_s = None
    for part in parts:
        with part.open("rb") as stream:
            for _, channel, message in make_reader(stream).iter_messages(
                ["/note/bracket", "/note/verdict", "/note/belief"]
            ):
                fields, now_s = json.loads(message.data), message.log_time / 1e9
                if fields.get("edge") == "begin":
                    begun_s, act_s, placed_s = now_s, None, None
                elif begun_s is not None and fields.get("edge") == "end":
                    yield (act_s or now_s) - begun_s, (placed_s or now_s) - begun_s
                elif channel.topic == "/note/verdict" and fields["decision"] == "act":
                    act_s = act_s or now_s
                elif fields.get("source") == "robot":
                    placed_s = placed_s or now_s


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, default=60)
    parser.add_argument("--tree", type=Path, default=ROOT / "trees" / "shift_ahead.xml")
    asked = parser.parse_args()
    pairs: list[tuple[tuple[float, float], tuple[float, float]]] = []
    right = [0, 0]
    for seed in range(FIRST_SEED, FIRST_SEED + -(-asked.pairs // len(GOALS))):
        runs = [firsts(seed, asked.tree, with_orders) for with_orders in (False, True)]
        pairs += zip(runs[0][0], runs[1][0], strict=False)
        right = [right[0] + runs[0][1], right[1] + runs[1][1]]
        values = np.array(pairs)
        earlier = values[:, 0] - values[:, 1]
        half = 1.96 * earlier.std(axis=0, ddof=1) / np.sqrt(len(earlier))
        for place, what in enumerate(("first act allowed", "first part placed")):
            without, with_orders = values[:, :, place].mean(axis=0)
            print(f"{len(pairs)} pairs, {what}: {without:.1f} s without orders, {with_orders:.1f} s with;", end=" ")
            print(
                f"{earlier[:, place].mean():.1f} +- {half[place]:.1f} s earlier; right {right[0]}, {right[1]}",
                flush=True,
            )


if __name__ == "__main__":
    main()
