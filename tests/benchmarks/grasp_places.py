"""What grasps beside a part's middle are worth: parts that can be taken at once, and moves, with them and without.

python -m tests.benchmarks.grasp_places --scenes 1000

In geometry, over every part of dense and loose scenes that no planner was trained on, each being asked for once.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from bracket_cell.fleet.intervals import wilson
from bracket_cell.learned.grasp.candidates import touching
from bracket_cell.learned.grasp.settings import TRAY_SCENES, GripperOutline, SceneSettings
from bracket_cell.learned.grasp.solution import nearest_first, solve
from bracket_lab.learned.grasp.scenes import Scene, draw_scenes
from tests.integration.cell_rig import PRODUCT

CLUTTERS = {"dense": SceneSettings(), "loose": TRAY_SCENES}
GRIPPERS = {"middle alone": GripperOutline(middle_alone=tuple(PRODUCT.parts)), "beside it, too": GripperOutline()}


@dataclass(frozen=True)
class Answers:
    """Of every part of all scenes: the fewest moves that free it, and whether none do."""

    moves: NDArray[np.int_]
    help: NDArray[np.bool_]

    @property
    def free(self) -> int:
        """Parts that can be taken as they stand."""
        return int(np.sum((self.moves == 0) & ~self.help))


RESAMPLED = 2000


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=2026, help="of the scenes; those of the test split")
    options = parser.parse_args()
    columns = ("scenes", "grasps", "parts", "free at once", "95 % interval", "help")
    table = Table(*columns, "moves a part", "fewer", title="moves: over parts that grasps in the middle free at all")
    for clutter, settings in CLUTTERS.items():
        scenes = list(draw_scenes(PRODUCT, options.seed, options.scenes, "test", settings))
        found = {name: answers(scenes, outline) for name, outline in GRIPPERS.items()}
        before = found["middle alone"]
        for name, some in found.items():
            moves, first = some.moves[~before.help], before.moves[~before.help]
            low, _, high = wilson(some.free, len(some.moves))
            shares = (some.free / len(some.moves), np.mean(some.help), np.mean(moves))
            free, needy, each = (f"{share:.3f}" for share in shares)
            fewer = _fewer(
                np.repeat(np.arange(len(scenes)), [len(scene.boxes) for scene in scenes])[~before.help], moves, first
            )
            table.add_row(clutter, name, str(len(some.moves)), free, f"{low:.3f} - {high:.3f}", needy, each, fewer)
    Console(width=140).print(table)


def _fewer(scene: NDArray[np.int_], moves: NDArray[np.int_], first: NDArray[np.int_]) -> str:
    """Share of moves that are saved, with its 95 % bootstrap interval over scenes."""
    each = np.array([np.bincount(scene, some) for some in (moves, first)])
    rng = np.random.default_rng(0)
    drawn = (each[:, rng.integers(each.shape[1], size=each.shape[1])].sum(axis=1) for _ in range(RESAMPLED))
    low, high = np.percentile([1 - some / max(1, all_) for some, all_ in drawn], [2.5, 97.5])
    return f"{1 - moves.sum() / max(1, first.sum()):.1%} ({low:.1%} - {high:.1%})"


def answers(scenes: Sequence[Scene], outline: GripperOutline) -> Answers:
    """The best answer about every part."""
    found = [
        solve(blocks, part, nearest_first(scene.boxes, part))
        for scene in scenes
        for blocks in (touching(scene.boxes, outline),)
        for part in range(len(scene.boxes))
    ]
    return Answers(
        np.array([len(solution.moves) for solution in found]), np.array([solution.needs_help for solution in found])
    )


if __name__ == "__main__":
    main()
