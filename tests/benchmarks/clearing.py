"""Algorithm 2 from pixels, executed: one required part out of 3 to 6, as Table 3 of the paper."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from bracket_cell.configuration import Configuration
from bracket_cell.fleet.intervals import wilson
from bracket_cell.learned.grasp.boxes import Boxes
from bracket_cell.learned.grasp.candidates import touching
from bracket_cell.learned.grasp.settings import PAPER_SCENES, GripperOutline
from bracket_cell.learned.grasp.solution import nearest_first, solve
from bracket_ground.files.row_store import RowStore
from bracket_lab.evaluations.figures import paper
from bracket_lab.learned.grasp.scenes import draw_scenes, standing_boxes
from bracket_lab.learned.scores import share
from bracket_sim.cell import SimCell
from bracket_sim.scene.clutter import sample_clutter, standing
from bracket_sim.scene.parts import ScenePart
from tests.integration.cell_rig import BENCH, COMMISSION, PRODUCT, Recorded, lifted, robot_alone, run_tree

SIZES = (3, 4, 5, 6)
MOST_DRAWS = 1000
BAR = {3: 0.95, 4: 0.93, 5: 0.91, 6: 0.88}

Draw = Callable[[int, int], tuple[tuple[ScenePart, ...], str]]


@dataclass(frozen=True)
class Case:
    """How one scene went.

    Attributes:
        fetched: the required part hung in the gripper at the end.
        fewest: moves that free it in truth; None where no sequence does.
        moves: parts moved aside.
        words: what was said last.
    """

    size: int
    seed: int
    fetched: bool
    fewest: int | None
    moves: int
    words: str

    @property
    def solved(self) -> bool:
        """Fetched, or help was asked for rightly."""
        return self.fetched or self.fewest is None

    @property
    def needless(self) -> int:
        """Moves beyond the fewest, or in vain."""
        return max(0, self.moves - (self.fewest or 0))


def tray_scene(size: int, seed: int) -> tuple[tuple[ScenePart, ...], str]:
    """A random scene of the simulator, many parts side by side, and the type that is required of it."""
    rng = np.random.default_rng(seed)
    names = list(PRODUCT.parts)
    types = [names[i] for i in rng.integers(len(names), size=size)]
    return sample_clutter(PRODUCT, BENCH.tray, types, rng), types[0]


def dense_scene(size: int, seed: int) -> tuple[tuple[ScenePart, ...], str]:
    """A scene as the grasp planners are tested on: every part within 20 mm of another one."""
    scene = next(draw_scenes(PRODUCT, seed, 1, "test", sizes=(size, size)))
    return in_tray(scene.boxes), scene.boxes.types[int(np.random.default_rng(seed).integers(size))]


def paper_scene(size: int, seed: int) -> tuple[tuple[ScenePart, ...], str]:
    """A scene like those of the paper's Table 3, executed with all ways to grasp that the robot has."""
    scene = next(draw_scenes(PRODUCT, seed, 1, "test", PAPER_SCENES, sizes=(size, size)))
    return in_tray(scene.boxes), scene.boxes.types[int(np.random.default_rng(seed).integers(size))]


def blocked_scene(size: int, seed: int) -> tuple[tuple[ScenePart, ...], str]:
    """The first such scene in which a type is within reach only after one move or more, and that type."""
    for scene in draw_scenes(PRODUCT, seed, MOST_DRAWS, "test", sizes=(size, size)):
        for part in sorted(set(scene.boxes.types)):
            if fewest_moves(scene.boxes, part):
                return in_tray(scene.boxes), part
    raise AssertionError(f"no scene of {size} parts among {MOST_DRAWS} needs a move")


def in_tray(boxes: Boxes) -> tuple[ScenePart, ...]:
    """Boxes, whose origin is the middle of the tray, as parts in the simulator's tray."""
    rows = zip(boxes.types, boxes.centre_m + np.array(BENCH.tray.centre_m[:2]), boxes.yaw_rad, strict=True)
    return tuple(standing(PRODUCT, BENCH.tray, name, centre, float(yaw)) for name, centre, yaw in rows)


def run_scenes(draw: Draw, seeds: Sequence[int], configuration: Configuration, store: RowStore) -> list[Case]:
    """A scene of every size for each seed; those that are in the store are not run again."""
    wanted = [(size, seed) for seed in seeds for size in SIZES]
    for size, seed in track(wanted, description="clutter", console=Console(stderr=True)):
        if (size, seed) not in store:
            store.add(asdict(fetch(draw, size, seed, configuration)))
    return [Case(**row) for row in store.rows_of(wanted)]


def fetch(draw: Draw, size: int, seed: int, configuration: Configuration) -> Case:
    """Fetch the required part of one scene."""
    scene, part = draw(size, seed)
    with robot_alone(scene, seed, BENCH) as cell:
        fewest = fewest_moves(true_boxes(cell), part)
        outcome, recorded = run_tree(cell, COMMISSION, "FetchPart", {"part": part}, configuration=configuration)
        fetched = lifted(cell, part)
    moves = sum(reason.endswith("moved aside") for reason in recorded.reasons())
    return Case(size, seed, fetched, fewest, moves, f"{part} ({outcome.reason}): {last_words(recorded)}")


def true_boxes(cell: SimCell) -> Boxes:
    """The parts as they stand in the simulator."""
    return standing_boxes(PRODUCT, [(body.part, cell.world.part_pose(body)) for body in cell.world.bodies])


def fewest_moves(boxes: Boxes, part: str) -> int | None:
    """Moves that free the easiest part of a type, by the gripper's true outline; None where no sequence does."""
    blocks = touching(boxes, GripperOutline())
    candidates = [index for index, name in enumerate(boxes.types) if name == part]
    solutions = [solve(blocks, index, nearest_first(boxes, index)) for index in candidates]
    return min((len(solution.moves) for solution in solutions if not solution.needs_help), default=None)


def last_words(recorded: Recorded) -> str:
    """The last different things that nodes said."""
    said = list(dict.fromkeys(recorded.reasons()))
    return "; ".join(said[-3:])


def report(title: str, cases: Sequence[Case]) -> None:
    """A row a size with 95 % Wilson intervals; every scene that was not solved, in words."""
    columns = ("parts", "scenes", "solved", "share", "95 % interval", "aim", "paper", "fetched", "help, justified")
    table = Table(*columns, "help, not justified", "moves", "needless moves", title=title)
    for size in (*SIZES, None):
        chosen = [case for case in cases if size in (case.size, None)]
        table.add_row("all" if size is None else str(size), *_cells(chosen, size))
    console = Console(width=160)
    console.print(table)
    for case in cases:
        if not case.fetched:
            told = "justified" if case.fewest is None else f"{case.fewest} moves would do"
            console.print(f"{case.size} parts, seed {case.seed}, {told}: {case.words}", highlight=False, soft_wrap=True)


def shares(cases: Sequence[Case]) -> dict[str, dict[str, float | int]]:
    """What was solved, with its interval, by number of parts; and of all of them."""
    by_size = {str(size or "all"): [case for case in cases if size in (case.size, None)] for size in (*SIZES, None)}
    return {size: share(sum(case.solved for case in some), len(some)) for size, some in by_size.items()}


def _cells(cases: Sequence[Case], size: int | None) -> list[str]:
    solved, total = sum(case.solved for case in cases), len(cases)
    low, _, high = wilson(solved, total)
    justified = sum(not case.fetched and case.fewest is None for case in cases)
    place = f"Table 3/executed/{size} parts"
    aims = ["", ""] if size is None else [f"{BAR[size]:.2f}", paper().printed(place, place)]
    return [
        str(total),
        str(solved),
        f"{solved / max(1, total):.3f}",
        f"{low:.3f} - {high:.3f}",
        *aims,
        str(sum(case.fetched for case in cases)),
        str(justified),
        str(total - solved),
        f"{sum(case.moves for case in cases) / max(1, total):.2f}",
        f"{sum(case.needless for case in cases) / max(1, total):.2f}",
    ]
