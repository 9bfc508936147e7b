"""Takes the README's picture: a portrait of the cell in the middle of a run.

python -m tests.benchmarks.readme_picture docs/cell.png --seed 1 --goal g0 --time 39.8
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2

from cell.observer import TickRecord
from sim.portrait import portrait
from sim.world import World
from tests.integration.cell_rig import ASSEMBLE, Diary, run_tree, with_person


class Photographer(Diary):
    """A diary that takes one picture."""

    def __init__(self, world: World, time_s: float, out: Path) -> None:
        super().__init__()
        self._world, self._time_s, self._out = world, time_s, out

    def tick(self, record: TickRecord) -> None:
        super().tick(record)
        if record.observation.time_s >= self._time_s and not self._out.exists():
            cv2.imwrite(str(self._out), cv2.cvtColor(portrait(self._world, 1200, 675), cv2.COLOR_RGB2BGR))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--goal", default="g0")
    parser.add_argument("--time", type=float, default=39.8, help="seconds of the run")
    options = parser.parse_args()
    options.out.unlink(missing_ok=True)
    with with_person(options.goal, options.seed) as cell:
        run_tree(cell, ASSEMBLE, diary=Photographer(cell.world, options.time, options.out))


if __name__ == "__main__":
    main()
