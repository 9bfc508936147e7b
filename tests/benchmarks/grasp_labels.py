"""Compares the grasp planner's labels with physics: simulated grasps without margins, judged by contacts.

python -m tests.benchmarks.grasp_labels --scenes 600 --speed 0.08

Scenes are drawn as for training; in each, one random part is grasped by every option that the stroke allows, at its
true pose. A grasp is good where the part is lifted and no neighbour was touched or moved by more than half a
millimetre. The label says the same from geometry.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from bracket_cell.fleet.intervals import wilson
from bracket_cell.learned.grasp.candidates import CANDIDATES, PLACE_M, SIDE, clearance_m
from bracket_cell.learned.grasp.settings import GripperOutline
from bracket_ground.interfaces.grip import Grip, Hold
from bracket_ground.interfaces.gripper import default_gripper
from bracket_lab.learned.grasp.scenes import Scene, draw_scenes
from tests.integration.cell_rig import BENCH, PRODUCT
from tests.integration.grasp_trial import Descent, Standing, Verdict, try_grasp
from tests.learned.grasp.layouts import can_grasp

OUTLINE = GripperOutline()
OPTIONS = {name: Hold(tuple(Grip)[side], place) for name, side, place in zip(CANDIDATES, SIDE, PLACE_M, strict=True)}
EDGES_MM = (-np.inf, -3.0, -1.0, -0.3, 0.0, 0.3, 1.0, 3.0, np.inf)


@dataclass(frozen=True)
class Trial:
    """One grasp and what label and physics say about it.

    Attributes:
        where: scene, part and option, to find it again.
        label: the geometric label: it can be grasped.
        room_m: by how much the gripper misses all neighbours in geometry; negative where it meets one.
    """

    where: str
    option: str
    label: bool
    room_m: float
    verdict: Verdict

    @property
    def agrees(self) -> bool:
        return self.label == self.verdict.good


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=600)
    parser.add_argument("--seed", type=int, default=0, help="of the scenes; those of the test split")
    parser.add_argument("--speed", type=float, help="of the descent [m/s]; the skills' own by default")
    options = parser.parse_args()
    descent = Descent(OUTLINE.clearance_m, OUTLINE.grasp_depth_m, options.speed)
    scenes = draw_scenes(PRODUCT, options.seed, options.scenes, "test")
    console = Console(stderr=True)
    trials: list[Trial] = []
    for number, scene in track(enumerate(scenes), total=options.scenes, description="grasps", console=console):
        part = int(np.random.default_rng([options.seed, number]).integers(len(scene.boxes)))
        trials += try_part(scene, number, part, descent)
    report(trials)


def try_part(scene: Scene, index: int, part: int, descent: Descent) -> Iterator[Trial]:
    """Grasp one part of a scene by every option that the stroke allows."""
    boxes = scene.boxes
    room = clearance_m(boxes, OUTLINE)
    neighbours = np.arange(len(boxes)) != part
    grips = default_gripper().grips(PRODUCT.parts[boxes.types[part]], OUTLINE.clearance_m)
    for number, (option, hold) in enumerate(OPTIONS.items()):
        if hold.grip not in grips:
            continue
        where = f"scene {index}, part {part} ({boxes.types[part]}), {option}"
        verdict = try_grasp(standing_in_tray(scene), part, hold, descent, where)
        room_m = float(room[part, number, neighbours].min(initial=np.inf))
        yield Trial(where, option, can_grasp(boxes, part, option, OUTLINE), room_m, verdict)


def standing_in_tray(scene: Scene) -> list[Standing]:
    """The parts of a scene, whose origin is the middle of the tray, in the world."""
    middle = np.array(BENCH.tray.centre_m[:2])
    rows = zip(scene.boxes.types, scene.boxes.centre_m + middle, scene.boxes.yaw_rad, strict=True)
    return [(name, (float(x), float(y)), float(yaw)) for name, (x, y), yaw in rows]


def report(trials: Sequence[Trial]) -> None:
    """Confusion by option, agreement by room, and all disagreements."""
    console = Console()
    table = Table("option", "both good", "both bad", "label good only", "physics good only", "agree", "95 % interval")
    for option in (*OPTIONS, "all"):
        chosen = [trial for trial in trials if option in (trial.option, "all")]
        counts = Counter((trial.label, trial.verdict.good) for trial in chosen)
        cells = [str(counts[pair]) for pair in ((True, True), (False, False), (True, False), (False, True))]
        table.add_row(option, *cells, *shares(chosen))
    console.print(table)
    table = Table("room of the label", "grasps", "label good", "physics good", "agree", "95 % interval")
    for low, high in pairwise(EDGES_MM):
        chosen = [trial for trial in trials if low <= trial.room_m * 1000 < high]
        good = (sum(trial.label for trial in chosen), sum(trial.verdict.good for trial in chosen))
        table.add_row(f"{low:.1f} to {high:.1f} mm", str(len(chosen)), *map(str, good), *shares(chosen))
    console.print(table)
    for trial in trials:
        if not trial.agrees:
            told = "can be grasped" if trial.label else "blocked"
            console.print(
                f"{trial.where}: label {told}, room {trial.room_m * 1000:+.2f} mm; {trial.verdict}",
                highlight=False,
                soft_wrap=True,
            )


def shares(trials: Sequence[Trial]) -> tuple[str, str]:
    """Share that agrees, and its interval."""
    agree = sum(trial.agrees for trial in trials)
    low, _, high = wilson(agree, len(trials))
    return f"{agree / max(1, len(trials)):.4f}", f"{low:.4f} - {high:.4f}"


if __name__ == "__main__":
    main()
