"""Algorithm 2 on stacks, from pixels and executed: the required part lies or stands under one or two others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from bracket_cell.configuration import Configuration
from bracket_cell.fleet.intervals import wilson
from bracket_cell.watching.observer import TickRecord
from bracket_sim.cell import SimCell
from bracket_sim.scene.clutter import sample_clutter
from bracket_sim.scene.parts import ScenePart
from bracket_sim.scene.settings import ClutterSettings
from bracket_sim.scene.world import World, build_world
from bracket_sim.truth.labels import Resting, resting_parts
from tests.benchmarks.clearing import last_words
from tests.integration.cell_rig import BENCH, COMMISSION, PRODUCT, Recorded, lifted, robot_alone, run_tree

PARTS = (3, 4, 5)
STACKED = ClutterSettings(stacked_share=0.8, lying_share=0.2)
MOST_ON_TOP = 2
MOST_DRAWS = 200
DROP_M = 0.03
BEFORE, AFTER = 2, 15  # ticks around the moment in which the fingers are seen to hold nothing any more


@dataclass(frozen=True)
class Case:
    """How one scene went.

    Attributes:
        fetched: the required part hung in the gripper at the end.
        drop_m: how far what was let go fell at most.
        off: parts that are outside the tray in the end.
    """

    seed: int
    on_top: int
    fetched: bool
    drop_m: float
    off: tuple[str, ...]
    moves: int
    words: str


@dataclass
class Watched(Recorded):
    """Also keeps how high each part is in every tick, and when the fingers let go."""

    world: World | None = None
    heights_m: list[tuple[float, ...]] = field(default_factory=list)
    let_go: list[int] = field(default_factory=list)
    _held: bool = False

    def tick(self, record: TickRecord) -> None:
        super().tick(record)
        assert self.world is not None
        held, self._held = self._held, record.observation.gripper.holding
        if held and not self._held:
            self.let_go.append(len(self.heights_m))
        self.heights_m.append(tuple(float(self.world.data.xpos[body.body][2]) for body in self.world.bodies))

    def drop_m(self) -> float:
        """How far anything fell at most when the fingers opened."""
        heights = np.array(self.heights_m)
        falls = [
            float((heights[max(at - BEFORE, 0)] - heights[at : at + AFTER].min(axis=0)).max()) for at in self.let_go
        ]
        return max(falls, default=0.0)


def stacked_scene(seed: int) -> tuple[tuple[ScenePart, ...], str, int]:
    """A tray, the only part of whose required type has one or two others on it; that type, and how many."""
    for number in range(MOST_DRAWS):
        rng = np.random.default_rng([seed, number])
        names = list(PRODUCT.parts)
        part = names[int(rng.integers(len(names)))]
        others = [name for name in names if name != part]
        types = [part, *(others[i] for i in rng.integers(len(others), size=int(rng.choice(PARTS)) - 1))]
        scene = sample_clutter(PRODUCT, BENCH.tray, types, rng, STACKED)
        world = build_world(PRODUCT, BENCH, scene)
        world.settle()
        resting = resting_parts(world)
        required = next(one for one in resting if one.part == part)
        if 1 <= (count := len(on_top(resting, required.name))) <= MOST_ON_TOP:
            return scene, part, count
    raise AssertionError(f"no stack in {MOST_DRAWS} draws of seed {seed}")


def on_top(resting: Sequence[Resting], name: str) -> set[str]:
    """Names of all that rest on one, by way of others, too."""
    found: set[str] = set()
    below = {name}
    while below:
        below = {one.name for one in resting if below & set(one.on)} - found
        found |= below
    return found


def fetch(seed: int, configuration: Configuration) -> Case:
    """Fetch the required part of one scene."""
    scene, part, count = stacked_scene(seed)
    with robot_alone(scene, seed) as cell:
        watched = Watched(world=cell.world)
        outcome, recorded = run_tree(cell, COMMISSION, "FetchPart", {"part": part}, watched, configuration)
        fetched, off = outcome.end == "finished" and lifted(cell, part), outside(cell)
    moves = sum(reason.endswith("moved aside") for reason in recorded.reasons())
    words = f"{part} ({outcome.reason}): {last_words(recorded)}"
    return Case(seed, count, fetched, watched.drop_m(), off, moves, words)


def outside(cell: SimCell) -> tuple[str, ...]:
    """Parts that are not over the tray."""
    tray = BENCH.tray
    places = {body.name: cell.world.data.xpos[body.body] for body in cell.world.bodies}
    half = np.array(tray.size_m) / 2
    return tuple(name for name, place in places.items() if (np.abs(place[:2] - tray.centre_m[:2]) > half).any())


def run_scenes(seeds: Sequence[int], configuration: Configuration) -> list[Case]:
    """A scene for each seed, one after the other; what went wrong is told at once."""
    cases = []
    for seed in track(seeds, description="stacks", console=Console(stderr=True)):
        cases.append(fetch(seed, configuration))
        if not cases[-1].fetched or cases[-1].drop_m > DROP_M or cases[-1].off:
            print(cases[-1], flush=True)
    return cases


def report(title: str, cases: Sequence[Case]) -> None:
    """A row for each number of parts on top, with 95 % Wilson intervals."""
    columns = ("on top", "scenes", "in the gripper", "share", "95 % interval", "moves", "let go above 3 cm", "off")
    table = Table(*columns, title=title)
    for count in (1, 2, None):
        some = [case for case in cases if count in (case.on_top, None)]
        done = sum(case.fetched for case in some)
        low, _, high = wilson(done, len(some))
        table.add_row(
            "all" if count is None else str(count),
            str(len(some)),
            str(done),
            f"{done / max(len(some), 1):.3f}",
            f"{low:.3f} - {high:.3f}",
            f"{sum(case.moves for case in some) / max(len(some), 1):.2f}",
            str(sum(case.drop_m > DROP_M for case in some)),
            str(sum(bool(case.off) for case in some)),
        )
    Console(width=140).print(table)
