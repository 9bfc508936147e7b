"""The whole controller on the simulated cell, from pixels, without a log: for tests and benchmarks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from pathlib import Path

from bracket_cell.configuration import Configuration, load_configuration, load_product
from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_cell.watching.observer import Outcome
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.product import Product
from bracket_sim.cell import SimCell
from bracket_sim.scene.parts import ScenePart
from bracket_sim.scene.settings import settings_of
from bracket_sim.testing import Recorded as Recorded  # who runs a tree reads it
from bracket_sim.testing import SimulatedCell
from tests import ROOT

ASSEMBLE = ROOT / "trees" / "assemble.xml"
COMMISSION = ROOT / "trees" / "commission.xml"
CONFIGURATION = load_configuration()
PRODUCT = load_product(CONFIGURATION)
BENCH = CONFIGURATION.bench
SIMULATION = settings_of(CONFIGURATION.devices.simulation)
CAN = CONFIGURATION.devices.gripper_bus
UNWATCHED = BENCH.model_copy(update={"overhead": BENCH.overhead.model_copy(update={"rate_hz": 5.0})})


@contextmanager
def robot_alone(clutter: Sequence[ScenePart], seed: int, bench: Bench = UNWATCHED) -> Iterator[SimCell]:
    """A cell without a person, with these parts in the tray, and fewer frames, as nobody is there to be watched.

    Args:
        bench: with all frames, where detectors are so slow that fewer would be too old.
    """
    with closing(SimCell(PRODUCT, bench, SIMULATION, *CAN, seed, "g0", worker=False, clutter=clutter)) as cell:
        yield cell


@contextmanager
def with_person(goal: str, seed: int) -> Iterator[SimCell]:
    """A cell with a person who assembles this goal."""
    with closing(SimCell(PRODUCT, BENCH, SIMULATION, *CAN, seed, goal)) as cell:
        yield cell


@contextmanager
def person_who_knows(product: Product, goal: str, seed: int) -> Iterator[SimCell]:
    """A cell with a person who assembles a goal that only they know."""
    with closing(SimCell(product, BENCH, SIMULATION, *CAN, seed, goal)) as cell:
        yield cell


_motion: list[MotionPlanner] = []


def motion_planner() -> MotionPlanner:
    """One motion planner for all runs of a process: it keeps no state between them."""
    if not _motion:
        _motion.append(MotionPlanner(PRODUCT, BENCH, CONFIGURATION.motion))
    return _motion[0]


def run_tree(
    cell: SimCell,
    tree: Path,
    main: str | None = None,
    provided: Mapping[str, object] | None = None,
    recorded: Recorded | None = None,
    configuration: Configuration = CONFIGURATION,
) -> tuple[Outcome, Recorded]:
    """Run a tree to its end on a cell."""
    return SimulatedCell(configuration, PRODUCT, cell, motion_planner()).run(tree, main, provided, recorded)


def lifted(cell: SimCell, part: str, height_m: float = 0.03) -> bool:
    """Whether a part of this type hangs above the tray in truth."""
    floor_m = BENCH.tray.centre_m[2] + PRODUCT.parts[part].peg_length_m
    heights_m = [cell.world.data.xpos[body.body][2] for body in cell.world.bodies if body.part == part]
    return any(height > floor_m + height_m for height in heights_m)
